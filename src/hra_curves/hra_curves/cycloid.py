"""The cycloid of paper 4 and the errors of curves that stand for it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from stage_core.arrays import Array

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


def nearest_points(points: Array) -> Array:
    """Points (m, 2) of the cycloid nearest to points (m, 2), metres.

    The cycloid stands as a polyline of 20000 pieces, whose sagitta of some 1e-11 m is below every
    error asked for.
    """
    nominal = cycloid(np.linspace(0.0, 2.0 * math.pi, 20001))
    _, vertex = cKDTree(nominal).query(points)
    best = nominal[vertex]
    smallest = ((points - best) ** 2).sum(axis=1)
    # The nearest point of the polyline lies on one of the two pieces that meet at that vertex.
    for first in (np.maximum(vertex - 1, 0), np.minimum(vertex, len(nominal) - 2)):
        start, piece = nominal[first], nominal[first + 1] - nominal[first]
        square = np.maximum((piece**2).sum(axis=1), np.finfo(float).tiny)
        along = np.clip(((points - start) * piece).sum(axis=1) / square, 0.0, 1.0)
        foot = start + along[:, None] * piece
        squares = ((points - foot) ** 2).sum(axis=1)
        nearer = squares < smallest
        best = np.where(nearer[:, None], foot, best)
        smallest = np.where(nearer, squares, smallest)
    return best


def error_to_the_curve(points: Array) -> float:
    """Largest distance of points (m, 2) to the nearest point of the cycloid, metres.

    For curves that know no angle, such as a spline over the chord length.
    """
    return float(np.linalg.norm(points - nearest_points(points), axis=1).max())
