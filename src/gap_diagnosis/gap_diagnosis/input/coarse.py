"""A tracker frame that is turned or far away, points that are late: taken out exactly, first.

The terms of the tracker link are linear in the rotation, which is good for milliradians, and take
the motion at the stamps: 3 ms late, a wave of 20 mm is 0.25 rad off at 0.26 m/s. What is larger is
found here by a rigid fit (in the plane, Umeyama, IEEE Trans. Pattern Anal. Mach. Intell. 13, 1991)
over a grid of lags, the points are moved back by it, and the small rest is fitted as ever.
"""

from __future__ import annotations

import cmath
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import held_out_windows, inside
from stage_core import topics
from stage_core.arrays import Array
from stage_core.errors import StageError

Plane = NDArray[np.complexfloating]

#: Effects that are taken out.
MOVED = ('tracker_misalignment', 'tracker_latency', 'tracker_clock_drift')
LEAST_ANGLE, LEAST_OFFSET, LEAST_LAG = 3e-3, 1e-3, 5e-4  # rad, m, s; less is fitted alone
LARGEST_LAG, LARGEST_DRIFT = 0.1, 1e-3  # s and s/s, of the twin's `tracker_latency` and clock
LARGEST_TRIED = 2.0  # s, of a clock that is no latency but another one
STEPS = (0.01, 0.001, 0.0001)  # s, of the grids of lags
MOST_POINTS = 3000
CLEARLY = 0.3  # times the RMS that something else leaves


@dataclass(frozen=True)
class Coarse:
    """Measured = R(angle) · table + offset [m], `latency` [s] after the table was there.

    The clock of the stamps runs fast by `drift` [s/s].
    """

    angle: float = 0.0
    offset: tuple[float, ...] = ()
    latency: float = 0.0
    drift: float = 0.0

    def turned(self, points: Array, back: bool = False) -> Array:
        """Directions (n, a) in the tracker's frame, or `back` in the table's."""
        if points.shape[1] == 1:
            return points
        angle = -self.angle if back else self.angle
        c, s = np.cos(angle), np.sin(angle)
        return np.asarray(points @ np.array([[c, s], [-s, c]]))

    def away(self, axes: int) -> Array:
        """Offset (axes,) [m]."""
        return np.asarray((self.offset or (0.0, 0.0))[:axes])

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects that these are the larger part of."""
        there = (self.angle or any(self.offset), self.latency, self.drift)
        return tuple(name for name, size in zip(MOVED, there, strict=True) if size)

    def without(self, barred: Collection[str]) -> Coarse:
        """The same without some of its effects."""
        turned, late, drifting = (name not in barred for name in MOVED)
        return Coarse(
            turned * self.angle,
            self.offset if turned else (),
            late * self.latency,
            drifting * self.drift,
        )


def find(records: list[Record]) -> Coarse:
    """Rotation, offset, latency and drift that are too large for the terms of the tracker link.

    Raises
    ------
    StageError
        If the points are later than any latency of the twin, or the frame is mirrored.
    """
    record = next(r for r in records if not r.held_out_session)
    assert record.tracker_time is not None and record.tracker is not None
    axes = len(record.axes)
    rests = record.row_noise is not None
    rows = np.flatnonzero(~inside(record.tracker_time, held_out_windows(record)))
    rows = rows[:: max(1, len(rows) // MOST_POINTS)]
    time = record.point_time()[rows]
    measured = _plane(record.tracker[rows])

    lag, drift = (0.0, 0.0) if rests else _late(record, time, measured)
    if abs(lag) > LARGEST_LAG:
        raise StageError(
            f'{record.name}: the stamps of {topics.TRACKER_POINT} are {lag:.2f} s late against '
            'the encoder: no latency but another clock; let the tracker bridge take its offset out'
        )

    def table(beyond: float = 0.0) -> Plane:
        return _plane(record.encoder_at(time / (1.0 + drift) - lag - beyond))

    where = table()
    if axes == 2 and _rest(measured.conj(), where, axes) < CLEARLY * _rest(measured, where, axes):
        raise StageError(
            f'{record.name}: the frame of {topics.TRACKER_POINT} is mirrored against the stage '
            '(one of its axes points the other way): align the tracker with `~/align`'
        )
    # On a circle a latency looks like a rotation: what remains of one is fitted beside it.
    speed = [table(-STEPS[1]) - table(STEPS[1])] if not rests else []
    beside = [*speed, *(time * v for v in speed)]
    angle = cmath.phase(_factor(measured, where, beside)) if axes == 2 else 0.0
    angle = angle if abs(angle) > LEAST_ANGLE else 0.0
    away = complex(measured.mean() - cmath.exp(1j * angle) * where.mean())
    far = bool(angle) or abs(away) > LEAST_OFFSET
    offset = (away.real, away.imag)[:axes] if far else (0.0,) * axes
    return Coarse(angle, offset, lag, drift)


def _late(record: Record, time: Array, measured: Plane) -> tuple[float, float]:
    """Latency [s] and drift of the clock [s/s] without which clearly more is left; else zero.

    Each of them alone is tried before both: on circles of one speed the two are alike.
    """
    middle, axes = float(np.mean(time)), len(record.axes)
    half = max(0.5 * float(np.ptp(time)), STEPS[0])

    def left(late: float, drift: float) -> float:
        """RMS that is left [m] of points that are `late` [s] in the middle of the session."""
        table = record.encoder_at(time - late - drift * (time - middle))
        return _rest(measured, _plane(table), axes)

    def best_drift(late: float, start: float) -> float:
        """Drift of points that are `late` at a time [s] from the session's start."""
        drift, since = 0.0, middle - start
        for step, reach in zip(STEPS[1:], (LARGEST_DRIFT * half, *STEPS[1:]), strict=False):
            drifts = drift + _grid(reach, step) / half
            drift = min(drifts, key=lambda d: left(late + float(d) * since, float(d)))
        return float(drift)

    late = 0.0
    for step, reach in zip(STEPS, (LARGEST_TRIED, *STEPS), strict=False):
        late = float(min(late + _grid(reach, step), key=lambda x: left(float(x), 0.0)))
    alone, beside = best_drift(0.0, 0.0), best_drift(late, middle)
    best, least = (0.0, 0.0), left(0.0, 0.0)
    one = min(((late, 0.0), (0.0, alone)), key=lambda x: left(x[0] + x[1] * middle, x[1]))
    for lag, drift in (one, (late - beside * middle, beside)):
        rest = left(lag + drift * middle, drift)
        if rest < CLEARLY * least and max(abs(lag), abs(drift) * half) > LEAST_LAG:
            best, least = (lag, drift), rest
    return best


def _grid(reach: float, step: float) -> Array:
    return np.arange(-reach, reach + 0.5 * step, step)


def moved_back(record: Record, coarse: Coarse) -> Record:
    """The record with its points where the table was, when it was there."""
    if not coarse.effects:
        return record
    assert record.tracker_time is not None and record.tracker is not None
    stamps = record.tracker_time if record.tracker_stamp is None else record.tracker_stamp
    moved = replace(
        record,
        tracker=coarse.turned(record.tracker - coarse.away(len(record.axes)), back=True),
        tracker_time=record.point_time(coarse.latency, coarse.drift),
        tracker_stamp=stamps / (1.0 + coarse.drift) - coarse.latency,
    )
    assert moved.tracker_time is not None and moved.tracker_stamp is not None
    assert moved.tracker is not None
    margin = 5 * record.period
    use = (moved.tracker_time > record.time[0] + margin) & (
        moved.tracker_time < record.time[-1] - margin
    )
    return replace(
        moved,
        tracker=moved.tracker[use],
        tracker_time=moved.tracker_time[use],
        tracker_stamp=moved.tracker_stamp[use],
    )


def _plane(points: Array) -> Plane:
    """Points (n, a) as complex numbers (n,)."""
    return np.asarray(points[:, 0] + (1j * points[:, 1] if points.shape[1] == 2 else 0j))


def _factor(measured: Plane, where: Plane, beside: Sequence[Plane]) -> complex:
    """Factor of the table in the measured points, beside an offset and other columns (n,)."""
    columns = np.column_stack([where, np.ones(len(where)), *beside])
    columns /= np.linalg.norm(columns, axis=0) + 1e-300
    return complex(np.linalg.lstsq(columns, measured)[0][0])


def _rest(measured: Plane, where: Plane, axes: int) -> float:
    """RMS that the best rotation (of two axes) and offset leave [m]."""
    z, w = measured - measured.mean(), where - where.mean()
    if axes == 1:
        return float(np.sqrt(np.mean(np.abs(z - w) ** 2)))
    square = np.mean(np.abs(z) ** 2) + np.mean(np.abs(w) ** 2) - 2.0 * abs(np.mean(z * w.conj()))
    return float(np.sqrt(max(float(square), 0.0)))
