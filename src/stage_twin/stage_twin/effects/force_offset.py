"""A constant force of the drive."""

from __future__ import annotations

import numpy as np

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term, constant

EFFECT = Effect(
    name='force_offset',
    link='servo',
    parameters=(
        Parameter('offset', 'N', -5000.0, 5000.0, 3.0, 'constant force on the moving mass'),
    ),
    model='Constant force of the drive: current sensor offset, inclined guide, tightened cover. '
    'Janot, Gautier, Brunot, EMPS (2019), offset term.',
    sentence='a constant force of {offset} acts on the moving mass',
    excited_by='strokes in both directions',
    exact=True,
    needs_effort="a constant force cannot be told from the controller's integral at the start",
)


def force(offset: float) -> float:
    """Force on the moving mass [N]."""
    return offset


def term(rows: ForceRows) -> Term:
    """A constant."""
    signal = rows.columns([-np.ones_like(p) for p in rows.position()])
    return Term(
        constant(signal),
        lambda theta, c: {'offset': float(c[0])},
    )
