"""How sure the parameters of a fit are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gap_diagnosis.residuals.regression import Fit, Regression
from stage_core.arrays import Array
from stage_twin.effects import effect_of
from stage_twin.effects.term import Theta

LEAST_BLOCKS = 12  # of which a deviation is told
SEEN = 1e-10  # least eigenvalue of what the rows show, over the largest: rounding makes 1e-12
SHARED = 1e-7  # share of a parameter that others may take the place of without a trace


class _Column(NamedTuple):
    """Derivatives by a parameter: of the rows (n,), and of the penalised roots of its term (k,).

    A penalised root is a coefficient times the root of its penalty (`Term.penalty`), so that the
    sum of their squares is what the penalty adds to the squares of the rows.
    """

    name: str
    linear: bool
    rows: Array
    rough: Array


def uncertainty(
    regression: Regression, fit: Fit, given: str | None = None
) -> dict[str, tuple[Array, Array]]:
    """Standard deviations of (θ, coefficients) of each term of a fit.

    Gauss-Newton covariance over all parameters together; the residual's autocorrelation is in it
    through the sums of blocks (sandwich estimate), and so is what the smoothness of a curve hides.
    The θ of the term `given` is held where it was found: its deviations are zero. So are those of
    parameters that others can take the place of, which no rows tell. Where an effect is judged by
    its coefficients together (`Effect.by_ratio`), those of `given` have the deviation of a factor
    of all.
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
        if name == given and _by_ratio(name):
            linear = [abs(c) * own for c in fit.coefficients[name] for own in linear]
        out[name] = np.array([0.0] * len(theta) if name == given else bent), np.array(linear)
    return out


def _columns(regression: Regression, fit: Fit, name: str, held: bool) -> list[_Column]:
    """Those of a term on the fit rows; of its coefficients alone where θ is held."""
    term, theta, coefficients = regression.problem.terms[name], fit.thetas[name], fit.coefficients
    own, weights = _weighted(regression, name, theta)
    out = []
    for i in range(0 if held else len(theta)):
        step = term.steps[i] if term.steps else 1e-3 * (term.upper[i] - term.lower[i])
        moved = list(theta)
        moved[i] += step if theta[i] + step < term.upper[i] else -step
        step = moved[i] - theta[i]
        columns, others = _weighted(regression, name, tuple(moved))
        change = (columns - own) @ coefficients[name] / step
        out.append(_Column(name, False, change, (others - weights) * coefficients[name] / step))
    if held and _by_ratio(name) and not term.fixed:
        factors = coefficients[name]
        out.append(_Column(name, True, own @ factors, weights * factors))
    elif not term.fixed:
        each = zip(own.T, np.diag(weights), strict=True)
        out += [_Column(name, True, rows, rough) for rows, rough in each]
    return out


def _by_ratio(name: str) -> bool:
    """Whether the coefficients of an effect are judged together."""
    return effect_of(name).by_ratio


def _weighted(regression: Regression, name: str, theta: Theta) -> tuple[Array, Array]:
    """Columns (n, k) of a term on the fit rows, and the roots of their penalties (k,)."""
    own = regression.columns(name, theta).take(regression.fit_rows, axis=0)
    counts = regression.problem.terms[name].penalty(np.sum(own**2, axis=0))
    return own, np.sqrt(counts)


def _deviations(regression: Regression, fit: Fit, columns: list[_Column]) -> Array:
    """Standard deviation (k,) of the parameter of each column; zero where no rows tell it."""
    matrix = np.column_stack([c.rows for c in columns])
    curves = [_curve(regression, fit, columns, name) for name in fit.thetas]
    rough = np.concatenate([curve for curve, _ in curves])
    values = np.concatenate([value for _, value in curves])
    scale = np.sqrt(np.sum(matrix**2, axis=0) + np.sum(rough**2, axis=0))
    scale[scale == 0.0] = np.inf  # what changes nothing here has no deviation
    matrix, rough = matrix / scale, rough / scale
    eigenvalues, vectors = np.linalg.eigh(matrix.T @ matrix + rough.T @ rough)
    kept = eigenvalues > SEEN * eigenvalues[-1]
    inverse = (vectors[:, kept] / eigenvalues[kept]) @ vectors[:, kept].T
    seen = (vectors[:, ~kept] ** 2).sum(axis=1) < SHARED
    variance = _scattered(regression, fit, matrix, inverse)
    told = 1.0 - np.sum((rough @ inverse) * rough, axis=1)
    ends = np.cumsum([len(value) for _, value in curves])[:-1]
    variance += (inverse @ rough.T) ** 2 @ _usual(np.split(values, ends), np.split(told, ends))
    return np.asarray(np.where(seen, np.sqrt(variance), 0.0) / scale)


def _curve(
    regression: Regression, fit: Fit, columns: list[_Column], name: str
) -> tuple[Array, Array]:
    """Derivatives (m, k) of a term's penalised roots by all parameters; their squares (m,)."""
    weights = _weighted(regression, name, fit.thetas[name])[1]
    used = weights > 0.0
    none = np.zeros(len(weights))
    rough = np.column_stack([c.rough if c.name == name else none for c in columns])[used]
    return rough, (weights * fit.coefficients[name])[used] ** 2


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


def _usual(values: list[Array], told: list[Array]) -> Array:
    """Variance (m,) of the penalised roots, by their squares and the share that the rows tell.

    It is one for each curve: a curve is about as rough where the rows do not tell it as where they
    do.
    """
    usual = [
        np.full(len(own), np.sum(own) / max(float(np.sum(share)), 1.0))
        for own, share in zip(values, told, strict=True)
    ]
    return np.concatenate(usual)
