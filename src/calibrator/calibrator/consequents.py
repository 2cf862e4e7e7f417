"""Consequents of the interval type-2 system by least squares (eqs. 28-33 of paper 1).

Two readings are settled here. The weights of eqs. 12 and 18 need the sign of F_j - mean, and F_j
needs the consequents that are sought: the solution starts from Nie-Tan weights, for which no sign
is needed, and takes up to three passes with the signs of the solution before, keeping the best.
And eq. 32 stacks Phi_L on Phi_R, while eqs. 28 and 29 require their mean, (N, M·(n+1)): the mean
is what is solved. "Interval" consequents of eq. 2 collapse to crisp ones in eqs. 13 and 19.
"""

from __future__ import annotations

import numpy as np

from calibrator.type_reduction import effective_weights
from stage_core.arrays import Array

SIGN_PASSES = 3


def regressors(weights: Array, inputs: Array) -> Array:
    """Rows [nu, nu·x_1, ..., nu·x_n] of eq. 14, (N, M·(n+1))."""
    columns = [weights] + [weights * inputs[:, k : k + 1] for k in range(inputs.shape[1])]
    return np.hstack(columns)


def rule_outputs(theta: Array, inputs: Array) -> Array:
    """F_j = beta_j + sum_k alpha_kj x_k of eq. 2 for theta ordered as eq. 16, (N, M)."""
    blocks = theta.reshape(inputs.shape[1] + 1, -1)
    return blocks[0] + inputs @ blocks[1:]


def fit_consequents(
    lower: Array, upper: Array, inputs: Array, target: Array, reduction: str
) -> Array:
    """Consequents theta (M·(n+1),) with the smallest mean squared error.

    Minimum-norm least squares (eq. 33), singular values below 1e-8 of the largest dropped.
    """
    weights = effective_weights(lower, upper, np.zeros_like(lower), 'nie_tan')
    best: Array | None = None
    best_error = np.inf
    for _ in range(1 + SIGN_PASSES):
        solution = np.linalg.lstsq(regressors(weights, inputs), target, rcond=1e-8)[0]
        theta: Array = np.asarray(solution, dtype=float)
        outputs = rule_outputs(theta, inputs)
        weights = effective_weights(lower, upper, outputs, reduction)
        error = float(np.mean((target - np.sum(weights * outputs, axis=1)) ** 2))
        if best is None or error < best_error:
            best, best_error = theta, error
    assert best is not None
    return best
