"""Errors of a prediction, by how surely it was made.

A smooth curve (`Term.roughness`) predicts a place that no other row visited by its smoothness
alone, with an error of its own size. Such a row says little against the curve, and little for
another effect that happens to go with its error there. So rows are compared by the logarithm of
their predictive density (Gneiting and Raftery, J. Amer. Statist. Assoc. 102, 2007) instead of by
their squares: of a row that was foreseen up to its noise that is the same.
"""

from __future__ import annotations

import numpy as np

from gap_diagnosis.residuals.normal import RIDGE
from stage_core.arrays import Array

#: Mean square of what a set leaves of the rows that it was fitted to, over that of their noise,
#: up to which its curve is believed elsewhere. Beside a delay that was found later a force left
#: 74; where the waves of a motor's slots were too short for any curve, one left 1e5.
BELIEVED = 1e3


def variances(
    rows: Array, gram: Array, penalty: Array, coefficients: Array, noise: float
) -> Array:
    """Variance (n,) of the error of a prediction, over that of a row's noise: 1 or more.

    Parameters
    ----------
    rows : columns at the rows that are predicted (n, k)
    gram, penalty : of the rows that fitted (k, k), and what the smoothness counts (k,)
    coefficients : what was fitted (k,)
    noise : variance of a row's noise
    """
    total = gram + np.diag(penalty)
    # Of a column of one fold alone the others hold rounding errors, of either sign.
    total.ravel()[:: len(total) + 1] = np.maximum(np.diag(total), 0.0)
    scale = np.sqrt(np.diag(total))
    scale[scale == 0.0] = 1.0
    values, vectors = np.linalg.eigh(total / np.outer(scale, scale))
    # Of the scaled matrix: inverse.T @ inverse.
    inverse = vectors.T / np.sqrt(np.maximum(values, 0.0) + RIDGE)[:, None]
    halves = inverse @ (rows / scale).T  # (k, n)
    told = 1.0 - penalty / scale**2 * np.sum(inverse**2, axis=0)
    # A curve is about as rough where the rows do not tell it as where they do.
    curve = penalty > 0.0
    rough = float(penalty @ coefficients**2) / max(float(np.sum(told[curve])), 1.0)
    # What the rows hold of another column may be next to nothing, and its move no number.
    moved = (inverse.T @ halves)[curve] / scale[curve, None]
    smooth = max(rough / noise - 1.0, 0.0) * (penalty[curve] @ moved**2)
    return np.asarray(1.0 + np.sum(halves**2, axis=0) + smooth)


def counted(errors: Array, variance: Array, noise: float) -> Array:
    """Errors (n,) whose squares are noise * (e² / v + log v)."""
    squares = errors**2 / variance + noise * np.log(variance)
    return np.asarray(np.copysign(np.sqrt(squares), errors))
