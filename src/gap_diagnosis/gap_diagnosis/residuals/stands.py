"""Stands of an encoder: while its reading stands, its rounding error is one number and no noise.

In motion the rounding changes from point to point, as noise does. The m points of a stand share an
error b of up to half a step, so that their covariance is σ² I + var(b) 1 1ᵀ. A few stands then
look like a play or a curve over the position, however many points they hold. Taking the share
1 - √λ, λ = σ² / (σ² + m var(b)), of a stand's mean from its rows makes them white (random effects:
Fuller and Battese, Journal of Econometrics 2, 1974).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.input.data import Record
from gap_diagnosis.input.noise import CLEARLY, encoder_step

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class Stands:
    """Stands of some rows: their first row, their rows, the share of the mean to take away."""

    first: Numbers
    count: Numbers
    share: Array

    @cached_property
    def rows(self) -> Numbers:
        """Numbers of all rows that stand."""
        before = np.cumsum(self.count) - self.count
        return np.arange(self.count.sum()) + np.repeat(self.first - before, self.count)

    def freed(self, rows: Array) -> Array:
        """Rows (n,) or (n, k) with the share of each stand's mean taken away."""
        if not len(self.first):
            return rows
        out = rows.copy()
        own = rows[self.rows]
        sums = np.add.reduceat(own, np.cumsum(self.count) - self.count, axis=0)
        weight = self.share / self.count
        out[self.rows] = own - np.repeat((sums.T * weight).T, self.count, axis=0)
        return out


def stands_of(records: list[Record], tracker_noise: float) -> Stands:
    """Stands of the tracker's rows: of each session one axis below the other.

    Parameters
    ----------
    tracker_noise : standard deviation of a point [m]
    """
    first, count, share = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0)]
    at = 0
    for record in records:
        assert record.tracker_time is not None
        for i in range(len(record.axes)):
            error = _rounding(record, i)
            points = np.interp(record.tracker_time, record.time, record.encoder[:, i])
            start, length = _one_reading(points, 0.01 * error)
            ratio = tracker_noise**2 / (tracker_noise**2 + length * error**2)
            first.append(at + start)
            count.append(length)
            share.append(1.0 - np.sqrt(ratio))
            at += len(points)
    return Stands(np.concatenate(first), np.concatenate(count), np.concatenate(share))


def _rounding(record: Record, i: int) -> float:
    """Standard deviation of an encoder's rounding [m]; 0 where noise makes it another each tick.

    Noise of 0.3 steps leaves a fiftieth of the variance to a stand (Widrow and Kollár,
    Quantization Noise, 2008, the first harmonic of the rounding's mean).
    """
    step = encoder_step(record.encoder[:, i])
    if record.noise is None or record.noise.axes[i].position ** 2 > CLEARLY * step**2 / 12.0:
        return 0.0
    return float(step / np.sqrt(12.0))


def _one_reading(points: Array, least: float) -> tuple[Numbers, Numbers]:
    """First point and number of points of each stretch without a change of `least` [m]."""
    edges = np.flatnonzero(np.abs(np.diff(points)) > least) + 1
    first = np.concatenate([[0], edges])
    count = np.diff(np.append(first, len(points)))
    return first[count > 1], count[count > 1]
