"""Contour error of a point against a free-form path: real-time estimates and the exact one.

The estimate follows Chen et al. (Int. J. Mach. Tools Manuf. 102, 2016; section 2.1 of paper 3):
the point of the contour that is compared lies on the curve, at the parameter of the reference
point plus a first-order step. The signed error is E' = -sin(t) e_x + cos(t) e_y with e the
contour point minus the measured one and t the tangent's angle there.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from contour_ctrl.path import PathTable
from stage_core.arrays import Array


@njit(cache=True)
def path_point(
    values: Array, step: float, closed: bool, s: float
) -> tuple[float, float, float, float, float, float]:
    """Return x, y, x', y', x'', y'' of a path table at parameter s (quintic Hermite)."""
    cells = values.shape[0] - 1
    length = cells * step
    if closed:
        s -= length * np.floor(s / length)
    else:
        s = min(max(s, 0.0), length)
    cell = min(int(s / step), cells - 1)
    t = s / step - cell
    x, dx, ddx = _hermite(values, cell, 0, step, t)
    y, dy, ddy = _hermite(values, cell, 1, step, t)
    return x, y, dx, dy, ddx, ddy


@njit(cache=True)
def _hermite(
    values: Array, cell: int, axis: int, step: float, t: float
) -> tuple[float, float, float]:
    c0 = values[cell, axis]
    c1 = values[cell, axis + 2] * step
    c2 = 0.5 * values[cell, axis + 4] * step * step
    a = values[cell + 1, axis] - c0 - c1 - c2
    b = values[cell + 1, axis + 2] * step - c1 - 2.0 * c2
    c = values[cell + 1, axis + 4] * step * step - 2.0 * c2
    c3 = 10.0 * a - 4.0 * b + 0.5 * c
    c4 = -15.0 * a + 7.0 * b - c
    c5 = 6.0 * a - 3.0 * b + 0.5 * c
    value = c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5))))
    first = c1 + t * (2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5)))
    second = 2.0 * c2 + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5))
    return value, first / step, second / (step * step)


@njit(cache=True)
def parameter_estimate(
    values: Array, step: float, closed: bool, s: float, qx: float, qy: float, steps: int
) -> float:
    """Return the signed contour error [m] of (qx, qy), started at the reference's parameter s.

    Each step solves the first-order expansion of (q - C(s)) . C'(s) = 0; where the expansion
    has no maximum (the point lies beyond the centre of curvature) the curvature term is left
    out. Zero steps give the tangent estimate.
    """
    x, y, dx, dy, ddx, ddy = path_point(values, step, closed, s)
    for _ in range(steps):
        slope = (qx - x) * dx + (qy - y) * dy
        squared = dx * dx + dy * dy
        bend = squared - (qx - x) * ddx - (qy - y) * ddy
        if bend < 0.1 * squared:
            bend = squared
        s += slope / bend
        x, y, dx, dy, ddx, ddy = path_point(values, step, closed, s)
    return (-dy * (x - qx) + dx * (y - qy)) / np.sqrt(dx * dx + dy * dy)


@njit(cache=True)
def osculating_estimate(
    values: Array, step: float, closed: bool, s: float, qx: float, qy: float
) -> float:
    """Return the signed contour error [m] against the osculating circle at parameter s."""
    x, y, dx, dy, ddx, ddy = path_point(values, step, closed, s)
    speed = np.sqrt(dx * dx + dy * dy)
    curvature = (dx * ddy - dy * ddx) / speed**3
    along = ((qx - x) * dx + (qy - y) * dy) / speed
    normal = (-(qx - x) * dy + (qy - y) * dx) / speed
    # Distance to the circle, written so that it stays exact for small curvature.
    across = 1.0 - curvature * normal
    root = np.sqrt(across * across + (curvature * along) ** 2)
    squares = curvature * (along * along + normal * normal) - 2.0 * normal
    return squares / (1.0 + root)


@njit(cache=True)
def estimates(values: Array, step: float, closed: bool, s: Array, q: Array, steps: int) -> Array:
    """Return (n,) signed contour errors of points (n, 2) with reference parameters (n,)."""
    result = np.empty(len(s))
    for k in range(len(s)):
        result[k] = parameter_estimate(values, step, closed, s[k], q[k, 0], q[k, 1], steps)
    return result


def of_record(path: PathTable, arc: Array, q: Array) -> Array:
    """Contour error (n,) [m] of measured points (n, 2), fully converged."""
    return estimates(path.values, path.step, path.closed, arc, np.ascontiguousarray(q), 12)
