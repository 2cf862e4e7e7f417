"""The cycloid of paper 4 and the errors of curves that stand for it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
RADIUS = 1e-3
SAMPLES = 400


def cycloid(theta: Array, radius: float = RADIUS) -> Array:
    """Points (m, 2) in metres at angles theta (m,), Section 3.2 of paper 4."""
    return radius * np.column_stack([theta - np.sin(theta), 1.0 - np.cos(theta)])


def error_at_equal_parameter(
    evaluate: Callable[[Array], Array], first: float, last: float, samples: int = SAMPLES
) -> float:
    """Largest distance to the cycloid at equal angle over [first, last] radians, metres."""
    theta = np.linspace(first, last, samples + 1)
    return float(np.linalg.norm(evaluate(theta) - cycloid(theta), axis=1).max())


def error_to_the_curve(points: Array) -> float:
    """Largest distance of points (m, 2) to the nearest point of the cycloid, metres.

    For curves that know no angle, such as a spline over the chord length. The cycloid stands as a
    polyline of 20000 pieces, whose sagitta of some 1e-11 m is below every error asked for.
    """
    nominal = cycloid(np.linspace(0.0, 2.0 * math.pi, 20001))
    starts, pieces = nominal[:-1], np.diff(nominal, axis=0)
    squares = np.maximum((pieces**2).sum(axis=1), np.finfo(float).tiny)
    worst = 0.0
    for point in points:
        offset = point - starts
        along = np.clip((offset * pieces).sum(axis=1) / squares, 0.0, 1.0)
        distance = np.linalg.norm(offset - along[:, None] * pieces, axis=1).min()
        worst = max(worst, float(distance))
    return worst
