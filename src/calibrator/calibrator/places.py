"""Distinct places and conditions among samples: repeats of one place tell nothing new about it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stage_core.arrays import Array

Labels = NDArray[np.int64]

REPEAT_GAP = 10.0
"""Repeats are nearer to one another than places are by this factor at least."""
REPEAT_SPAN = 0.01
"""Samples further apart than this share of the travel are never repeats of one place."""
MOST_CLUSTERED = 2000
"""More samples than this are points of a path: their distances are not looked through."""
CELL = 0.05
"""Cells of this share of the travel stand for the places of a path."""
MOST_PLACES = 300
"""More distinct places than this are judged by cells, which leave neighbours out together."""
REVISIT = 0.7
"""A place is visited again within this share of the distance of neighbouring places.

Rasters of 5 to 20 lines that are run once have no such place in their other half, whether they are
exact or moved by a quarter of a step; of grids there and back (`calibration_grid`, 3 to 10 lines)
99 % of the places or more, and of 60 random places 10 in each half.
"""


def distinct_places(command: ArrayLike) -> Labels:
    """Label (n,) of the place that each sample (n, axes) was taken at, from 0.

    The distances at which single linkage joins samples fall into two groups where places were
    visited again: the scatter of repeats and the distances of places. Between them lies a gap.
    """
    c = np.asarray(command, dtype=float)
    span = float(np.ptp(c, axis=0).max())
    if len(c) < 2 or span <= 0.0:
        return np.zeros(len(c), dtype=np.int64)
    if len(c) > MOST_CLUSTERED:
        return _labels(np.unique(c, axis=0, return_inverse=True)[1].reshape(-1), c)
    return _joined(c.tobytes(), c.shape, span).copy()


@lru_cache(maxsize=64)  # every candidate of a choice is fitted to the same folds
def _joined(content: bytes, shape: tuple[int, ...], span: float) -> Labels:
    """The labels of samples that extend over `span`, by single linkage."""
    # Only here: it takes a fifth of a second to import.
    from scipy.cluster.hierarchy import fcluster, linkage

    c = np.frombuffer(content).reshape(shape)
    joined = linkage(c, 'single')
    heights = np.maximum(np.sort(joined[:, 2]), 1e-9 * span)
    ratios = heights[1:] / heights[:-1]
    ratios[heights[:-1] > REPEAT_SPAN * span] = 0.0
    cut = 1e-9 * span
    if len(ratios) and ratios.max() > REPEAT_GAP:
        gap = int(np.argmax(ratios))
        cut = float(np.sqrt(heights[gap] * heights[gap + 1]))
    return _labels(fcluster(joined, cut, 'distance'), c)


def judged_places(command: ArrayLike) -> Labels:
    """Labels (n,) of what is left out together when a model is judged.

    Distinct places; cells of `CELL` of the travel where there are more than `MOST_PLACES`, as in
    a path, whose neighbouring points are no independent witnesses.
    """
    c = np.asarray(command, dtype=float)
    labels = distinct_places(c)
    if labels.max(initial=0) < MOST_PLACES:
        return labels
    cells = np.floor((c - c.min(axis=0)) / (CELL * float(np.ptp(c, axis=0).max())))
    return _labels(np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1), c)


def folds(labels: Labels, count: int, seed: int = 0) -> list[NDArray[np.bool_]]:
    """Masks (n,) of the samples that each of `count` folds leaves out, whole places each."""
    drawn = np.random.default_rng(seed).permutation(int(labels.max()) + 1)
    fold = np.empty(len(drawn), dtype=np.int64)
    fold[drawn] = np.arange(len(drawn)) % min(count, len(drawn))
    return [fold[labels] == k for k in range(min(count, len(drawn)))]


def revisited(command: Array, others: Array) -> NDArray[np.bool_]:
    """Mask (n,) of the samples (n, axes) [m] at a place of `others` (m, axes), see `REVISIT`."""
    from scipy.spatial import cKDTree

    places = others[np.unique(distinct_places(others), return_index=True)[1]]
    tree = cKDTree(places)
    # A single place has no neighbour, whose distance would be infinite.
    apart = np.median(tree.query(places, k=2)[0][:, 1]) if len(places) > 1 else 0.0
    return np.asarray(tree.query(command)[0] <= REVISIT * apart)


def _labels(values: NDArray[np.integer], command: Array) -> Labels:
    """Labels from 0 in the order of their places, however the samples are ordered."""
    _, first, inverse = np.unique(values, return_index=True, return_inverse=True)
    rank = np.argsort(np.lexsort(command[first].T[::-1]))
    return np.asarray(rank[inverse.reshape(-1)], dtype=np.int64)
