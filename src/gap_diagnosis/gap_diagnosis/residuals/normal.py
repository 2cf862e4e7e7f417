"""Least squares through normal equations."""

from __future__ import annotations

import numpy as np

from stage_core.arrays import Array

#: Added to the unit diagonal of normal equations, against exact collinearity.
RIDGE = 1e-10


def solve(matrix: Array, target: Array) -> Array:
    """Least squares through scaled normal equations, a tiny ridge against exact collinearity."""
    return solve_gram(matrix.T @ matrix, matrix.T @ target)


def solve_gram(gram: Array, right: Array, penalty: Array | float = 0.0) -> Array:
    """Solution of normal equations, scaled to a unit diagonal.

    `penalty` (k,) is what the square of each coefficient counts beside the squares of the rows.
    """
    scaled = gram.copy()
    diagonal = scaled.reshape(-1)[:: len(scaled) + 1]  # a view
    diagonal += penalty
    scale = np.sqrt(np.maximum(diagonal, 0.0))
    scale[scale == 0.0] = 1.0
    scaled /= scale[:, None] * scale
    diagonal += RIDGE
    return np.asarray(np.linalg.solve(scaled, right / scale) / scale)


def predicts(columns: Array, target: Array, old: Array) -> bool:
    """Whether coefficients from one half of some rows suit the other half better than old ones."""
    middle = len(target) // 2
    first, second = slice(None, middle), slice(middle, None)
    left = [
        target[b] - columns[b] @ solve(columns[a], target[a])
        for a, b in ((first, second), (second, first))
    ]
    kept = target - columns @ old
    return sum(float(r @ r) for r in left) < float(kept @ kept)
