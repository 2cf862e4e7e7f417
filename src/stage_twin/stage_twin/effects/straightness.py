"""A guide that is not straight: it displaces the other axis."""

from __future__ import annotations

import numpy as np

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import TrackerRows
from stage_twin.effects.shared import CENTRE, HALF_RANGE
from stage_twin.effects.term import Term, constant

EFFECT = Effect(
    name='straightness',
    link='kinematic',
    parameters=(
        Parameter('quadratic', 'm', -1e-3, 1e-3, 4e-6, 'bow: factor of P2(s)'),
        Parameter('cubic', 'm', -1e-3, 1e-3, 0.0, 'S shape: factor of P3(s)'),
        CENTRE,
        HALF_RANGE,
    ),
    model='Displaces the other axis by quadratic * P2(s) + cubic * P3(s), s = (p - centre) / '
    'half_range; Legendre polynomials are orthogonal to a line, so that the least-squares '
    'reference line is removed. ISO 230-1:2012; ISO/TR 16907:2015.',
    sentence='the guide is bent: it displaces the other axis by up to {quadratic} (bow) and '
    '{cubic} (S shape)',
    excited_by='the whole travel at a fixed place of the other axis',
)


def across(
    position: float, quadratic: float, cubic: float, centre: float, half_range: float
) -> float:
    """Displacement of the other axis [m]."""
    s = (position - centre) / half_range
    second = 0.5 * (3.0 * s * s - 1.0)
    third = 0.5 * (5.0 * s * s - 3.0) * s
    return quadratic * second + cubic * third


def term(rows: TrackerRows) -> Term | None:
    """Legendre polynomials of second and third order over the travel, across the axis."""
    if len(rows.axes) != 2:
        return None
    centre, half = rows.travel
    parts = []
    for position in rows.position():
        s = (position - centre) / half
        parts.append(np.column_stack([1.5 * s**2 - 0.5, 2.5 * s**3 - 1.5 * s]))
    return Term(
        constant(rows.across(parts)),
        lambda theta, c: {
            'quadratic': float(c[0]),
            'cubic': float(c[1]),
            'centre': centre,
            'half_range': half,
        },
        admissible=lambda theta, c: float(np.max(np.abs(c))) < 1e-3,
    )
