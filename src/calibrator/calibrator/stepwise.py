"""Stepwise linear regression by p-values, through the sweep operator on the scaled Gram matrix.

The rule is that of MATLAB's stepwisefit: enter the candidate with the smallest p-value below
`enter`; where there is none, remove the term with the largest p-value above `remove`; repeat.
Columns are centred and scaled to unit length (the thermal terms of paper 2 span eight decades),
so that a step costs one rank-one update of a small matrix instead of a regression.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stage_core.arrays import Array
from stage_core.errors import StageError

COLLINEAR = 1e-9
"""A candidate whose squared distance from the terms in the model is below this never enters."""


@dataclass(frozen=True)
class StepwiseFit:
    """Result of a stepwise regression.

    Attributes
    ----------
    selected
        Indices of the terms in the model, ascending, (p,).
    coefficients
        Of all candidates, (n,), zero outside the model.
    intercept
        Constant.
    sigma
        Standard deviation of the residual.
    path
        Steps in order: +(index + 1) entered, -(index + 1) removed.
    """

    selected: NDArray[np.int64]
    coefficients: Array
    intercept: float
    sigma: float
    path: tuple[int, ...]

    def predict(self, columns: ArrayLike) -> Array:
        """Values of candidate columns (m, n), shape (m,)."""
        return self.intercept + np.asarray(columns, dtype=float) @ self.coefficients


def stepwise(
    columns: ArrayLike, target: ArrayLike, enter: float = 0.05, remove: float = 0.10
) -> StepwiseFit:
    """Select and fit terms.

    Parameters
    ----------
    columns
        Candidates, (m, n).
    target
        (m,).
    enter, remove
        P-values to enter (below) and to be removed (above); enter <= remove, or the selection
        could cycle.

    Raises
    ------
    StageError
        For thresholds out of order, fewer than three samples, a NaN, or a constant target.
    """
    x, y = np.asarray(columns, dtype=float), np.asarray(target, dtype=float)
    if not 0.0 < enter <= remove < 1.0:
        raise StageError(f'stepwise needs 0 < enter <= remove < 1, got {enter} and {remove}')
    if x.ndim != 2 or y.shape != (len(x),) or len(x) < 3:
        raise StageError(
            f'stepwise got columns {x.shape} and target {y.shape}: give 3 rows or more'
        )
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise StageError('a column of the regression is not finite: remove those samples')
    mean, target_mean = x.mean(axis=0), float(y.mean())
    centred = np.column_stack([x - mean, y - target_mean])
    gram = centred.T @ centred
    length = np.sqrt(np.diagonal(gram))
    if length[-1] <= 0.0:
        raise StageError('the target is constant: there is nothing to explain')
    # A column that is constant up to rounding has no direction of its own.
    alive = length[:-1] > 1e-12 * np.sqrt(len(x)) * np.maximum(np.abs(mean), 1e-300)
    size = np.where(length > 0.0, length, 1.0)
    inside, path, matrix = _select(gram / np.outer(size, size), alive, len(x), enter, remove)
    chosen = np.flatnonzero(inside)
    coefficients = np.zeros(x.shape[1])
    coefficients[chosen] = matrix[chosen, -1] * length[-1] / length[chosen]
    freedom = len(x) - len(chosen) - 1
    left = max(float(matrix[-1, -1]), 0.0)
    return StepwiseFit(
        chosen,
        coefficients,
        target_mean - float(mean @ coefficients),
        float(length[-1] * np.sqrt(left / freedom)),
        tuple(path),
    )


def _select(
    matrix: Array, alive: NDArray[np.bool_], samples: int, enter: float, remove: float
) -> tuple[NDArray[np.bool_], list[int], Array]:
    candidates = len(alive)
    inside = np.zeros(candidates, dtype=bool)
    path: list[int] = []
    # Each step lowers a criterion, but rounding could make two terms swap for ever.
    for _ in range(20 * candidates + 20):
        diagonal, right = np.diagonal(matrix)[:-1], matrix[:-1, -1]
        out = alive & ~inside & (diagonal > COLLINEAR)
        freedom = samples - int(inside.sum()) - 2
        if out.any() and freedom > 0:
            gain = np.where(out, right**2 / np.where(out, diagonal, 1.0), -1.0)
            best = int(np.argmax(gain))
            f = gain[best] * freedom / max(float(matrix[-1, -1]) - gain[best], 1e-300)
            if _p_values(np.array([f]), freedom)[0] < enter:
                _sweep(matrix, best, 1.0)
                inside[best] = True
                path.append(best + 1)
                continue
        chosen = np.flatnonzero(inside)
        if not len(chosen):
            break
        freedom = samples - len(chosen) - 1
        f_values = _f_inside(matrix, chosen, freedom)
        worst = int(np.argmin(f_values))
        if _p_values(f_values[worst : worst + 1], freedom)[0] <= remove:
            break
        _sweep(matrix, int(chosen[worst]), -1.0)
        inside[chosen[worst]] = False
        path.append(-int(chosen[worst]) - 1)
    return inside, path, matrix


def _f_inside(matrix: Array, chosen: NDArray[np.int64], freedom: int) -> Array:
    """F value of removing each term in the model."""
    inverse = -np.diagonal(matrix)[chosen]
    return matrix[chosen, -1] ** 2 / inverse * freedom / max(float(matrix[-1, -1]), 1e-300)


def _p_values(f: Array, freedom: int) -> Array:
    """Upper tail of the F distribution with 1 and `freedom` degrees: the two-sided t test."""
    # Only here: it takes a quarter of a second to import.
    from scipy.special import betainc

    return np.asarray(betainc(freedom / 2.0, 0.5, freedom / (freedom + f)), dtype=float)


def _sweep(matrix: Array, k: int, sign: float) -> None:
    """Sweep a symmetric matrix on pivot k in place (sign 1 enters a term, -1 takes it out)."""
    pivot = matrix[k, k]
    row = matrix[k].copy()
    matrix -= np.outer(row / pivot, row)
    matrix[k] = sign * row / pivot
    matrix[:, k] = sign * row / pivot
    matrix[k, k] = -1.0 / pivot
