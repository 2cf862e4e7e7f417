"""Yaw of the carriage, seen with an Abbe arm."""

from __future__ import annotations

import numpy as np

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import TrackerRows
from stage_twin.effects.shared import CENTRE, HALF_RANGE
from stage_twin.effects.term import Term, constant

EFFECT = Effect(
    name='angular_error',
    link='kinematic',
    parameters=(
        Parameter('linear', 'rad', -5e-3, 5e-3, 40e-6, 'yaw at the end of the travel'),
        Parameter('quadratic', 'rad', -5e-3, 5e-3, 0.0, 'factor of P2(s) in the yaw'),
        Parameter(
            'arm',
            'm',
            -1.0,
            1.0,
            0.05,
            'Abbe arm from the guide to the point measured',
            neutral=None,
        ),
        CENTRE,
        HALF_RANGE,
    ),
    model='Yaw of the carriage, linear * s + quadratic * P2(s), s = (p - centre) / half_range, '
    'moves the point along its axis by yaw times the arm plus the other coordinate: for x '
    '-yaw * (y + arm), for y +yaw * (x + arm). Bryan, "The Abbe principle revisited", Precision '
    'Engineering 1 (1979); paper 1, section 2.',
    sentence='the carriage yaws by {linear} from the middle of the travel to its end',
    excited_by='the same line along the axis at two far coordinates of the other axis',
    separated_from={
        'scale_error': 'the same line along the axis at two far coordinates of the other axis: '
        'only yaw changes the slope',
    },
    holds=('scale_error',),
)


def turn(
    position: float,
    other: float,
    side: float,
    linear: float,
    quadratic: float,
    arm: float,
    centre: float,
    half_range: float,
) -> float:
    """Displacement of the point along the axis [m]."""
    s = (position - centre) / half_range
    yaw = linear * s + quadratic * 0.5 * (3.0 * s * s - 1.0)
    return side * yaw * (other + arm)


def term(rows: TrackerRows) -> Term | None:
    """The place over the travel, times the other coordinate and alone."""
    if len(rows.axes) != 2:
        return None
    centre, half = rows.travel
    sign = -1.0 if rows.axis == rows.axes[0] else 1.0
    parts = []
    for position, across in zip(rows.position(), rows.position_across(), strict=True):
        s = (position - centre) / half
        parts.append(sign * np.column_stack([s * across, s]))
    return Term(
        constant(rows.along(parts)),
        lambda theta, c: {
            'linear': float(c[0]),
            'quadratic': 0.0,
            'arm': float(c[1] / c[0]),
            'centre': centre,
            'half_range': half,
        },
        admissible=lambda theta, c: abs(c[0]) < 5e-3 and abs(c[1]) < abs(c[0]),
    )
