"""Stands of an encoder: while its reading stands, its rounding error is one number and no noise.

In motion the rounding changes from point to point, as noise does. The m points of a stand share an
error b of up to half a step, so that their covariance is σ² I + var(b) 1 1ᵀ. A few stands then
look like a play or a curve over the position, however many points they hold. Taking the share
1 - √λ, λ = σ² / (σ² + m var(b)), of a stand's mean from its rows makes them white (random effects:
Fuller and Battese, Journal of Econometrics 2, 1974).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gap_diagnosis.input.data import Record
from gap_diagnosis.input.noise import CLEARLY, encoder_step
from stage_core.arrays import Array

Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class Stands:
    """Stands of some rows: their first row, their rows, the share of the mean to take away."""

    first: Numbers
    count: Numbers
    share: Array

    def freed(self, rows: Array) -> Array:
        """Rows (n,) or (n, k) with the share of each stand's mean taken away."""
        if not len(self.first):
            return rows
        out = np.array(rows, dtype=np.float64, order='C')
        _free(out.reshape(len(out), -1), self.first, self.count, self.share)
        return out


@njit(cache=True)
def _free(rows: Array, first: Numbers, count: Numbers, share: Array) -> None:
    """Take the share of each stand's mean out of rows (n, k) in place."""
    for stand in range(len(first)):
        start, stop = first[stand], first[stand] + count[stand]
        for j in range(rows.shape[1]):
            mean = rows[start:stop, j].sum() / count[stand]
            rows[start:stop, j] -= share[stand] * mean


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
