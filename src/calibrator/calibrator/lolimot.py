"""Local linear model tree (LOLIMOT, paper 5, eqs. 5-9): linear models blended by Gaussians.

The tree splits one hyper-rectangle after the other in halves. Widths are proportional to the
rectangle, sigma = `overlap` · width: the paper's text calls them "equal constants", which cannot
give its own numbers (11c); proportional ones of at most 0.15 do, to every printed digit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from stage_core.arrays import Array
from stage_core.errors import StageError


@dataclass(frozen=True)
class LocalLinearTree:
    """Rectangles and linear models.

    Attributes
    ----------
    low, high
        Corners of the rectangles, (M, inputs).
    weights
        Offset and slopes per rectangle, (M, 1 + inputs); the paper prints them in the order
        slope, offset.
    overlap
        Width of a Gaussian in widths of its rectangle.
    """

    low: Array
    high: Array
    weights: Array
    overlap: float

    def validity(self, inputs: ArrayLike) -> Array:
        """Normalised Gaussian validity functions of eqs. 8 and 9, (n, M), rows sum to one."""
        return validity(np.asarray(inputs, dtype=float), self.low, self.high, self.overlap)

    def predict(self, inputs: ArrayLike) -> Array:
        """Network output of eq. 7, (n,)."""
        u = np.asarray(inputs, dtype=float)
        extended = np.column_stack([np.ones(len(u)), u])
        return np.sum(self.validity(u) * (extended @ self.weights.T), axis=1)


def validity(inputs: Array, low: Array, high: Array, overlap: float) -> Array:
    """Validity functions of rectangles (M, p) at inputs (n, p); rows sum to one (eq. 6)."""
    sigma = overlap * (high - low)
    distance = (inputs[:, None, :] - 0.5 * (low + high)[None]) / sigma[None]
    exponent = -0.5 * np.sum(distance**2, axis=2)
    # Relative to the nearest rectangle: far outside, all Gaussians underflow.
    strength = np.exp(exponent - exponent.max(axis=1, keepdims=True))
    return strength / strength.sum(axis=1, keepdims=True)


def halves(low: Array, high: Array, cell: int, dimension: int) -> tuple[Array, Array]:
    """Corners of the rectangles after one was split in the middle of a dimension.

    The halves stand where the whole stood, the lower one first.
    """
    middle = 0.5 * (low[cell, dimension] + high[cell, dimension])
    new_low, new_high = np.insert(low, cell, low[cell], 0), np.insert(high, cell, high[cell], 0)
    new_high[cell, dimension] = new_low[cell + 1, dimension] = middle
    return new_low, new_high


def fit_local(inputs: Array, target: Array, low: Array, high: Array, overlap: float) -> Array:
    """Weights (M, 1 + p) by local weighted least squares, one model after the other."""
    phi = validity(inputs, low, high, overlap)
    extended = np.column_stack([np.ones(len(inputs)), inputs])
    weights = []
    for column in phi.T:
        root = np.sqrt(column)[:, None]
        weights.append(np.linalg.lstsq(extended * root, target * root[:, 0], rcond=None)[0])
    return np.array(weights)


def grow(
    inputs: ArrayLike,
    target: ArrayLike,
    models: int = 20,
    overlap: float = 0.1,
    split_all: bool = False,
    penalty: float | None = 2.0,
) -> list[LocalLinearTree]:
    """Trees with 1, 2, ... local models; the last one is the choice.

    Parameters
    ----------
    inputs, target
        (n, p) and (n,).
    models
        Largest number of local models.
    split_all
        Try to split every model (section 4 of the paper) instead of the worst one (section 3.2).
    penalty
        The growth stops when n·log(mse) + penalty·parameters (Akaike's criterion for 2) rises
        twice in a row; None only stops at `models`.

    Raises
    ------
    StageError
        With fewer samples than one local model has parameters.
    """
    u, y = np.asarray(inputs, dtype=float), np.asarray(target, dtype=float)
    if len(u) < u.shape[1] + 2:
        raise StageError(f'{len(u)} samples are too few for a local linear model: record more')
    low, high = u.min(axis=0)[None], u.max(axis=0)[None]
    trees = [LocalLinearTree(low, high, fit_local(u, y, low, high, overlap), overlap)]
    scores = [_score(trees[0], u, y, penalty)]
    while len(trees) < models:
        best = _best_split(trees[-1], u, y, split_all)
        if best is None:
            break
        trees.append(best)
        scores.append(_score(best, u, y, penalty))
        if penalty is not None and len(scores) > 2 and min(scores[-2:]) > min(scores[:-2]):
            break
    if penalty is not None:
        trees = trees[: int(np.argmin(scores)) + 1]
    return trees


def _best_split(
    tree: LocalLinearTree, u: Array, y: Array, split_all: bool
) -> LocalLinearTree | None:
    local_loss = tree.validity(u).T @ (y - tree.predict(u)) ** 2
    cells = range(len(tree.low)) if split_all else [int(np.argmax(local_loss))]
    best, best_error = None, np.inf
    needed = u.shape[1] + 2
    for cell in cells:
        for dimension in range(u.shape[1]):
            low, high = halves(tree.low, tree.high, cell, dimension)
            owner = np.argmax(validity(u, low, high, tree.overlap), axis=1)
            if min(np.count_nonzero(owner == c) for c in (cell, cell + 1)) < needed:
                continue
            candidate = replace(
                tree, low=low, high=high, weights=fit_local(u, y, low, high, tree.overlap)
            )
            error = float(np.mean((y - candidate.predict(u)) ** 2))
            if error < best_error:
                best, best_error = candidate, error
    return best


def _score(tree: LocalLinearTree, u: Array, y: Array, penalty: float | None) -> float:
    error = float(np.mean((y - tree.predict(u)) ** 2))
    return len(y) * float(np.log(max(error, 1e-300))) + (penalty or 0.0) * tree.weights.size
