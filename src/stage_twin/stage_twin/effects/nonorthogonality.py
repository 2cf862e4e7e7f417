"""Squareness error of two stacked axes."""

from __future__ import annotations

import math

import numpy as np

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import TrackerRows
from stage_twin.effects.term import Term, constant

EFFECT = Effect(
    name='nonorthogonality',
    link='kinematic',
    parameters=(
        Parameter(
            'angle', 'rad', -0.05, 0.05, 80e-6, 'x_t = x - sin(angle) * y, y_t = cos(angle) * y'
        ),
    ),
    model='Squareness error of two stacked axes. ISO 230-1:2012; paper 1, section 2.',
    sentence='the axes are out of square by {angle}',
    excited_by='lines along both axes',
    per_axis=False,
    seen_by_encoder=False,
)


def plane(x: float, y: float, angle: float) -> tuple[float, float]:
    """Table position [m] of two axes' positions."""
    return x - math.sin(angle) * y, math.cos(angle) * y


def term(rows: TrackerRows) -> Term | None:
    """The second coordinate, along the first axis."""
    if not rows.both_move:
        return None
    signal = rows.rows([[-p[:, 1:2], np.zeros((len(p), 1))] for p in rows.points()])
    return Term(
        constant(signal),
        lambda theta, c: {'angle': float(np.arcsin(np.clip(c[0], -0.05, 0.05)))},
    )
