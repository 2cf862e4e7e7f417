"""How sure the parameters of a fit are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.residuals.regression import Fit, Regression

Array = NDArray[np.float64]

LEAST_BLOCKS = 12  # of which a deviation is told
SEEN = 1e-10  # least eigenvalue of what the rows show, over the largest: rounding makes 1e-12
SHARED = 1e-7  # share of a parameter that others may take the place of without a trace


class _Column(NamedTuple):
    """What the rows (n,) change with a parameter, and what its square counts as rough."""

    name: str
    linear: bool
    rows: Array
    penalty: float = 0.0
    value: float = 0.0


def uncertainty(
    regression: Regression, fit: Fit, given: str | None = None
) -> dict[str, tuple[Array, Array]]:
    """Standard deviations of (θ, coefficients) of each term of a fit.

    Gauss-Newton covariance over all parameters together; the residual's autocorrelation is in it
    through the sums of blocks (sandwich estimate), and so is what the smoothness of a curve hides.
    The θ of the term `given` is held where it was found: its deviations are zero. So are those of
    parameters that others can take the place of, which no rows tell.
    """
    columns = [c for name in fit.thetas for c in _columns(regression, fit, name, name == given)]
    if not columns:
        return {}
    deviations = _deviations(regression, fit, columns)
    out: dict[str, tuple[Array, Array]] = {}
    for name, theta in fit.thetas.items():
        bent, linear = (
            [d for d, c in zip(deviations, columns, strict=True) if (c.name, c.linear) == of]
            for of in ((name, False), (name, True))
        )
        out[name] = np.array([0.0] * len(theta) if name == given else bent), np.array(linear)
    return out


def _columns(regression: Regression, fit: Fit, name: str, held: bool) -> list[_Column]:
    """Those of a term on the fit rows; of its coefficients alone where θ is held."""
    term, theta, rows = regression.problem.terms[name], fit.thetas[name], regression.fit_rows
    own, coefficients = regression.columns(name, theta)[rows], fit.coefficients[name]
    out = []
    for i in range(0 if held else len(theta)):
        step = term.steps[i] if term.steps else 1e-3 * (term.upper[i] - term.lower[i])
        moved = list(theta)
        moved[i] += step if theta[i] + step < term.upper[i] else -step
        change = (regression.columns(name, tuple(moved))[rows] - own) @ coefficients
        out.append(_Column(name, False, change / (moved[i] - theta[i])))
    if not term.fixed:
        counts = term.penalty(np.sum(own**2, axis=0)).tolist()
        values = coefficients.tolist()
        out += [_Column(name, True, *one) for one in zip(own.T, counts, values, strict=True)]
    return out


def _deviations(regression: Regression, fit: Fit, columns: list[_Column]) -> Array:
    """Standard deviation (k,) of the parameter of each column; zero where no rows tell it."""
    matrix = np.column_stack([c.rows for c in columns])
    penalty = np.array([c.penalty for c in columns])
    scale = np.sqrt(np.sum(matrix**2, axis=0) + penalty)
    scale[scale == 0.0] = np.inf  # what changes nothing here has no deviation
    matrix, penalty = matrix / scale, penalty / scale**2
    values, vectors = np.linalg.eigh(matrix.T @ matrix + np.diag(penalty))
    kept = values > SEEN * values[-1]
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    seen = (vectors[:, ~kept] ** 2).sum(axis=1) < SHARED
    variance = _scattered(regression, fit, matrix, inverse)
    told = 1.0 - penalty * np.diag(inverse)
    variance += inverse**2 @ (penalty * _roughness(columns, told))
    return np.asarray(np.where(seen, np.sqrt(variance), 0.0) / scale)


def _scattered(regression: Regression, fit: Fit, matrix: Array, inverse: Array) -> Array:
    """Variance (k,) by the sums of blocks of what the fit leaves.

    What a model leaves may be slow: blocks are doubled as long as a dozen are left, and the
    largest figure counts (Flyvbjerg and Petersen, J. Chem. Phys. 91, 1989).
    """
    rows = regression.fit_rows
    scores = matrix * fit.residual[rows][:, None]
    labels = np.unique(regression.problem.block[rows], return_inverse=True)[1]
    count, variance = int(labels.max()) + 1, np.zeros(matrix.shape[1])
    while count >= LEAST_BLOCKS or not variance.any():
        sums = np.zeros((count, matrix.shape[1]))
        np.add.at(sums, labels, scores)
        variance = np.maximum(variance, np.diag(inverse @ (sums.T @ sums) @ inverse))
        labels, count = labels // 2, (count + 1) // 2
        if count < 2:
            break
    return variance


def _roughness(columns: list[_Column], told: Array) -> Array:
    """What each coefficient (k,) usually counts as rough, and how much of each the rows tell.

    A curve is about as rough where the rows do not tell it as where they do.
    """
    out = np.zeros(len(columns))
    for name in {c.name for c in columns}:
        own = np.array([c.name == name and c.penalty > 0.0 for c in columns])
        counted = sum(c.penalty * c.value**2 for c in columns if c.name == name)
        out[own] = counted / max(float(np.sum(told[own])), 1.0)
    return out
