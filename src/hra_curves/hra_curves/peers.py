"""What a user would pick otherwise: splines over the chord length and of fewer control points.

Polylines and splines through points are SciPy's `make_interp_spline` and `CubicSpline`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline, make_lsq_spline

from stage_core.arrays import Array
from stage_core.errors import StageError

Evaluator = Callable[[Array], Array]


def chord_length_spline(points: Array) -> tuple[Array, Evaluator]:
    """Natural cubic spline over the chord length, what the CAM system of paper 4 draws.

    Returns
    -------
    nodes : (n+1,) chord lengths of the points, metres. evaluate : over these nodes.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if (steps <= 0.0).any():
        raise StageError('two neighbouring points coincide: remove one of them')
    nodes = np.concatenate(([0.0], np.cumsum(steps)))
    return nodes, CubicSpline(nodes, points, bc_type='natural')


def least_squares_b_spline(
    nodes: Array, points: Array, control_points: int, degree: int = 3
) -> Evaluator:
    """Least-squares B-spline with uniform knots and ``control_points`` control points."""
    if not degree < control_points <= nodes.size:
        raise StageError(
            f'{control_points} control points for a B-spline of degree {degree} through '
            f'{nodes.size} points: give from {degree + 1} to {nodes.size}'
        )
    inner = np.linspace(nodes[0], nodes[-1], control_points - degree + 1)
    knots = np.concatenate(([nodes[0]] * degree, inner, [nodes[-1]] * degree))
    return make_lsq_spline(nodes, points, knots, k=degree)
