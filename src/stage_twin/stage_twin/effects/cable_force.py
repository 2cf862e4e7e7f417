"""The cable chain as a spring."""

from __future__ import annotations

import numpy as np

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term, constant

EFFECT = Effect(
    name='cable_force',
    link='servo',
    parameters=(
        Parameter('stiffness', 'N/m', 0.0, 2e4, 100.0, 'restoring force per displacement'),
        Parameter('centre', 'm', -1.0, 1.0, 0.0, 'position without cable force'),
        Parameter(
            'hardening', 'N/m³', 0.0, 1e6, 0.0, 'growth of the stiffness with displacement squared'
        ),
    ),
    model='Force -(stiffness * s + hardening * s^3), s = p - centre: the cable chain as a spring. '
    'Altintas et al., "Machine tool feed drives", CIRP Annals 60 (2011), disturbance forces.',
    sentence='a spring of {stiffness} pulls the axis back, as a cable chain does',
    excited_by='slow strokes over the whole travel',
    holds=('force_offset',),
)


def term(rows: ForceRows) -> Term:
    """The position and a constant."""
    p = rows.position()
    signal = rows.columns(p, [np.ones_like(pi) for pi in p])
    return Term(
        constant(signal),
        lambda theta, c: {'stiffness': float(c[0]), 'centre': float(-c[1] / c[0])},
        admissible=lambda theta, c: bool(0.0 < c[0] < 2e4 and abs(c[1]) < c[0]),
    )
