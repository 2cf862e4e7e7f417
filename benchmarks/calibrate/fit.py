"""Logistic regression of the truth of statements on their features.

A feature counts where it lowers the log-loss on the generator that the fit did not see.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, xlogy

from stage_core.arrays import Array

Weights = dict[str, float]
Row = dict[str, Any]

#: Features that may tell true statements of a kind from false ones.
CANDIDATES: dict[str, tuple[str, ...]] = {
    'named': (
        'strength', 'shrink', 'surely', 'away', 'gap', 'left', 'turns', 'rivals', 'structured',
        'servo', 'kinematic',
    ),
    'passed': ('strength', 'rival', 'gap', 'left', 'structured', 'unknown'),
    'unknown': ('share', 'gap', 'left'),
    'none': ('gap', 'left', 'turns'),
}  # fmt: skip
#: Least share by which a feature lowers the log-loss, so that chance adds none.
WORTHWHILE = 0.05
#: Penalty on squared weights, that of a normal prior of deviation 1/2: features are logarithms,
#: counts and flags.
RIDGE = 4.0


def statements(rows: Sequence[Row], kind: str) -> list[Row]:
    """The statements of a kind in some sessions, each with its generator."""
    return [
        {**s, 'generator': row['generator'], 'session': row['name']}
        for row in rows
        for s in row['statements']
        if s['kind'] == kind
    ]


def weights_of(found: Sequence[Row], names: Sequence[str]) -> Weights:
    """Weights of the features and of the constant (`1`): ridge logistic regression.

    Half a true and half a false statement at the mean of the features stand for what was not seen
    (Jeffreys' prior of the constant).
    """
    matrix = table(found, names)
    mean = matrix.mean(axis=0) if len(matrix) else np.zeros(len(names))
    columns = np.vstack([matrix - mean, np.zeros((2, len(names)))])
    true = np.array([s['true'] for s in found] + [True, False], dtype=float)
    count = np.r_[np.ones(len(found)), 0.5, 0.5]

    def loss(w: Array) -> tuple[float, Array]:
        at = w[0] + columns @ w[1:]
        value = count @ (np.logaddexp(0.0, at) - true * at) + 0.5 * RIDGE * float(w[1:] @ w[1:])
        slope = count * (expit(at) - true)
        return float(value), np.r_[slope.sum(), columns.T @ slope + RIDGE * w[1:]]

    w = minimize(loss, np.zeros(1 + len(names)), jac=True, method='BFGS').x
    constant = float(w[0] - w[1:] @ mean)
    return {'1': constant, **dict(zip(names, (float(v) for v in w[1:]), strict=True))}


def table(found: Sequence[Row], names: Sequence[str]) -> Array:
    """Features (n, k) of statements; a feature that is not kept is 0."""
    return np.array([[s['features'].get(n, 0.0) for n in names] for s in found]).reshape(
        len(found), len(names)
    )


def stated(weights: Weights, found: Sequence[Row]) -> Array:
    """Probabilities (n,) of statements."""
    names = [n for n in weights if n != '1']
    return np.asarray(
        expit(weights['1'] + table(found, names) @ np.array([weights[n] for n in names]))
    )


def left_out(found: Sequence[Row], names: Sequence[str]) -> Array:
    """Probability (n,) of each statement by the statements of the other generators."""
    out = np.zeros(len(found))
    for generator in {s['generator'] for s in found}:
        own = np.array([s['generator'] == generator for s in found])
        others = [s for s, mine in zip(found, own, strict=True) if not mine]
        mine = [s for s, is_own in zip(found, own, strict=True) if is_own]
        out[own] = stated(weights_of(others, names), mine)
    return out


def left_out_loss(found: Sequence[Row], names: Sequence[str]) -> float:
    """Log-loss (mean negative log-likelihood) of statements by those of the other generators."""
    true = np.array([s['true'] for s in found], dtype=float)
    probability = left_out(found, names)
    return float(-np.mean(xlogy(true, probability) + xlogy(1.0 - true, 1.0 - probability)))


def choose(found: Sequence[Row], candidates: Sequence[str]) -> list[str]:
    """Features taken one by one while the left-out log-loss falls by `WORTHWHILE`."""
    chosen: list[str] = []
    best = left_out_loss(found, chosen) if found else 0.0
    while found and len(chosen) < len(candidates):
        trials = {n: left_out_loss(found, [*chosen, n]) for n in candidates if n not in chosen}
        name = min(trials, key=lambda n: trials[n])
        if trials[name] > (1.0 - WORTHWHILE) * best:
            break
        chosen, best = [*chosen, name], trials[name]
    return chosen
