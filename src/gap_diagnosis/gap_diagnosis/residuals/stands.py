"""Stands of an encoder: while its reading stands, its rounding error is one number and no noise.

In motion the rounding changes from point to point, as noise does. In a stand of m points all share
an error b of up to half a step, so that their covariance is σ² I + var(b) 1 1ᵀ. A few stands then
look like a play or a curve over the position, however many points they hold. Taking the share
1 - √λ, λ = σ² / (σ² + m var(b)), of a stand's mean from its rows makes them white (random effects:
Fuller and Battese, Journal of Econometrics 2, 1974).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.input.data import Record
from gap_diagnosis.input.noise import CLEARLY, encoder_step

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: Shortest stand [s]; an encoder that makes ten steps a second and more has none.
SHORTEST = 0.1


@dataclass(frozen=True)
class Stands:
    """Stands of some rows: first row, row after the last, share of the mean to take away."""

    first: Numbers
    after: Numbers
    share: Array

    def freed(self, rows: Array) -> Array:
        """Rows (n,) or (n, k) with the share of each stand's mean taken away."""
        if not len(self.first):
            return rows
        out = rows.copy()
        for first, after, share in zip(self.first, self.after, self.share, strict=True):
            out[first:after] -= share * out[first:after].mean(axis=0)
        return out


def stands_of(records: list[Record], tracker_noise: float) -> Stands:
    """Stands of the tracker's rows: of each session one axis below the other.

    Parameters
    ----------
    tracker_noise : standard deviation of a point [m]
    """
    first, after, share = [], [], []
    at = 0
    for record in records:
        assert record.tracker_time is not None
        for i in range(len(record.axes)):
            error = _rounding(record, i)
            points = np.interp(record.tracker_time, record.time, record.encoder[:, i])
            for a, b in _runs(points, record.tracker_time, error * np.sqrt(12.0)):
                first.append(at + a)
                after.append(at + b)
                ratio = tracker_noise**2 / (tracker_noise**2 + (b - a) * error**2)
                share.append(1.0 - np.sqrt(ratio))
            at += len(points)
    return Stands(np.array(first, np.int64), np.array(after, np.int64), np.array(share))


def _rounding(record: Record, i: int) -> float:
    """Standard deviation of an encoder's rounding [m]; 0 where noise makes it another each tick.

    Noise of 0.3 steps leaves a fiftieth of the variance to a stand (Widrow and Kollár,
    Quantization Noise, 2008, the first harmonic of the rounding's mean).
    """
    step = encoder_step(record.encoder[:, i])
    if record.noise is None or record.noise.axes[i].position ** 2 > CLEARLY * step**2 / 12.0:
        return 0.0
    return float(step / np.sqrt(12.0))


def _runs(points: Array, time: Array, step: float) -> list[tuple[int, int]]:
    """Stretches of at least `SHORTEST` with one reading at the points (m,)."""
    if step == 0.0:
        return []
    edges = np.flatnonzero(np.abs(np.diff(points)) > 0.01 * step) + 1
    bounds = [0, *edges.tolist(), len(points)]
    return [
        (a, b)
        for a, b in zip(bounds, bounds[1:], strict=False)
        if time[b - 1] - time[a] >= SHORTEST
    ]
