"""The one rule by which a model is taken: its held-out gain has an interval above zero."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stage_core.arrays import Array

DRAWS = 2000
"""Resamples of the places: the 2.5 % quantile then moves by some 2 % of the interval's width."""
LEVEL = 0.95


@dataclass(frozen=True)
class Gain:
    """By how much a model lowers the held-out RMS, as a share of it, over distinct places.

    Attributes
    ----------
    value
        1 - RMS after / RMS before; negative where the model is worse.
    low, high
        Its 95 % interval.
    places
        Distinct places that were held out.
    left_out
        What was held out beside places, as `whole sessions are`; else empty.
    """

    value: float
    low: float
    high: float
    places: int
    left_out: str = ''

    @property
    def proven(self) -> bool:
        """Whether the whole interval lies above zero."""
        return self.low > 0.0

    def __str__(self) -> str:
        text = f'gain {100 * self.value:.0f} % [{100 * self.low:.0f}, {100 * self.high:.0f}]'
        return f'{text} where {self.left_out} left out' if self.left_out else text


def held_out_gain(before: Array, after: Array, places: NDArray[np.int64], seed: int = 0) -> Gain:
    """Gain over held-out errors, with an interval from a block bootstrap over the places.

    Parameters
    ----------
    before, after
        Errors (n, axes) of the uncalibrated stage and of the model [m].
    places
        Label (n,) of the place of each sample: places are drawn with all their samples, because
        repeats of a place share its error.
    """
    labels = np.unique(places, return_inverse=True)[1].reshape(-1)
    squares = np.column_stack(
        [np.bincount(labels, np.sum(error**2, axis=1)) for error in (before, after)]
    )
    drawn = np.random.default_rng(seed).integers(0, len(squares), (DRAWS, len(squares)))
    sums = np.vstack([squares.sum(axis=0), squares[drawn].sum(axis=1)])
    # Without any error before and after there is nothing to gain, and nothing to divide by.
    gains = 1.0 - np.sqrt((sums[:, 1] + 1e-300) / (sums[:, 0] + 1e-300))
    tail = (1.0 - LEVEL) / 2.0
    low, high = np.quantile(gains[1:], [tail, 1.0 - tail])
    return Gain(float(gains[0]), float(low), float(high), len(squares))
