"""What one fit gains over another, block by block, and how sure that is."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.regression import Fit
from stage_core.arrays import Array


def block_gains(problem: Problem, base: Fit, other: Fit) -> Array:
    """Mean-square gain of `other` over `base` per block, weighted by its rows."""
    rows = problem.judged
    gain = base.crossed[rows] ** 2 - other.crossed[rows] ** 2
    labels = problem.judged_block
    sums = np.bincount(labels, weights=gain)
    return np.asarray(sums * (len(sums) / len(gain)))


def block_rms_gains(problem: Problem, base: Fit, other: Fit) -> Array:
    """Gain of `other` over `base` in RMS per block.

    A few reversals hold most of the squared gain; the root keeps them from deciding alone.
    """
    rows = problem.judged
    labels = problem.judged_block
    count = np.bincount(labels)
    before = np.sqrt(np.bincount(labels, weights=base.crossed[rows] ** 2) / count)
    after = np.sqrt(np.bincount(labels, weights=other.crossed[rows] ** 2) / count)
    return np.asarray(before - after)


@lru_cache(maxsize=64)
def weights(seed: int, draws: int, count: int) -> Array:
    """Weights (draws, count) of the Bayesian bootstrap (Rubin, Annals of Statistics 9, 1981).

    They sum to one. No block drops out, so that what shows in two or three blocks alone (a force
    that is clipped once) is not lost by chance.
    """
    raw = np.random.default_rng(seed).standard_exponential((draws, count))
    made = np.asarray(raw / raw.sum(axis=1, keepdims=True))
    made.setflags(write=False)  # every caller has the same ones
    return made


def bootstrap_interval(
    gains: Array, seed: int, draws: int = 500, level: float = 0.95
) -> tuple[float, float]:
    """Percentile interval of the mean of block gains."""
    tail = 50.0 * (1.0 - level)
    means = weights(seed, draws, len(gains)) @ gains
    low, high = np.percentile(means, [tail, 100.0 - tail])
    return float(low), float(high)
