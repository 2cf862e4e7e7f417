"""Stamps of the tracker that scatter about the times of its points.

A stamp that is late by ε moves a point by -v ε: the residual of the measurement is then white,
and its power grows with the square of the speed. A wrong latency grows with the speed too, but it
follows the motion from point to point, which the sixth difference of the residual does not see.
"""

from __future__ import annotations

import math

import numpy as np

from gap_diagnosis.input.data import Record
from gap_diagnosis.input.noise import (
    AGREE,
    LEAST_BLOCKS,
    ORDER,
    SURE,
    TRACKER_BLOCK,
    rough,
    speed_fit,
)
from gap_diagnosis.residuals.kinematics import Kinematics
from gap_diagnosis.selection.parts import Part
from stage_core.arrays import Array

#: Largest correlation of neighbouring points of a white residual, less what chance makes of it.
WHITE = 0.2
#: Mean square of the sixth difference (`rough`) of what alternates from point to point, over that
#: of the signal.
ALTERNATING = 4.0**ORDER / math.comb(2 * ORDER, ORDER)


def point_speeds(record: Record) -> Array:
    """Velocity (m, a) [m/s] of the axes at the tracker points."""
    assert record.tracker_time is not None
    time, step = record.tracker_time, record.period
    return (record.encoder_at(time + step) - record.encoder_at(time - step)) / (2.0 * step)


def tracker_speeds(records: list[Record]) -> dict[str, float]:
    """Root mean square of each axis' velocity at the tracker points [m/s]; empty without any."""
    seen = [r for r in records if r.tracker is not None]
    if not seen:
        return {}
    squares = np.mean(np.concatenate([point_speeds(r) for r in seen]) ** 2, axis=0)
    return {axis: float(v) for axis, v in zip(seen[0].axes, np.sqrt(squares), strict=True)}


def tracker_jitter(parts: list[Part]) -> tuple[float, float] | None:
    """Jitter [s] of the tracker's stamps and its standard deviation; None where none is shown.

    Every axis that moves shows the same one.
    """
    part = next((p for p in parts if p.name == 'tracker'), None)
    if part is None or not isinstance(part.rows, Kinematics) or part.rows.rests:
        return None
    shown: list[list[tuple[Array, Array]]] = [[] for _ in part.rows.axes]
    start = 0
    for record in part.rows.records:
        for i, speed in enumerate(point_speeds(record).T):
            shown[i].append((part.residual[start : start + len(speed)], speed))
            start += len(speed)
    moving = [i for i in range(len(shown)) if any(r.moving[i] for r in part.rows.records)]
    problem = part.problem
    found = [_of_axis(shown[i], problem.floor, problem.rounding) for i in moving]
    told = [f for f in found if f is not None]
    if not told or len(told) < len(found):
        return None
    values = [value for value, _ in told]
    if max(values) > AGREE * min(values):
        return None
    return float(np.mean(values)), max(std for _, std in told)


def jitter_weights(part: Part) -> Array | None:
    """Weights (n,) of the rows of a tracker's part by their noise; None where no jitter shows.

    What is small beside the scatter of fast points shows in the slow ones.
    """
    found = tracker_jitter([part])
    if found is None or not isinstance(part.rows, Kinematics):
        return None
    speed = np.concatenate([point_speeds(r).T.ravel() for r in part.rows.records])
    noise = part.problem.floor
    return np.asarray(noise / np.hypot(noise, found[0] * speed))


def _of_axis(
    sessions: list[tuple[Array, Array]], floor: float, rounding: float
) -> tuple[float, float] | None:
    """Jitter of an axis [s] and its deviation, from residual and velocity (m,) of each session.

    `floor` [m] is the noise, `rounding` [m²] the mean square of what the encoder rounds.
    """
    powers, squares = [], []
    for residual, speed in sessions:
        if not _white(residual):
            return None
        smooth = rough(residual)
        count = len(smooth) // TRACKER_BLOCK * TRACKER_BLOCK
        skip = (len(residual) - len(smooth)) // 2
        powers.append(np.mean(smooth[:count].reshape(-1, TRACKER_BLOCK) ** 2, axis=1))
        inner = speed[skip : skip + count]
        squares.append(np.mean(inner.reshape(-1, TRACKER_BLOCK) ** 2, axis=1))
    power, square = np.concatenate(powers), np.concatenate(squares)
    if len(power) < LEAST_BLOCKS:
        return None
    _, jitter, deviation = speed_fit(power, square)
    mean = float(np.mean(square))
    if jitter <= SURE * deviation or jitter * mean < floor**2:
        return None
    # What the encoder rounds grows with the speed, too, but not beyond what its steps can make.
    if float(np.mean(power[square > mean])) < floor**2 + ALTERNATING * rounding:
        return None
    return math.sqrt(jitter), 0.5 * deviation / math.sqrt(jitter)


def _white(residual: Array) -> bool:
    """Whether neighbouring points know nothing of one another."""
    correlation = float(residual[1:] @ residual[:-1]) / float(residual @ residual)
    return abs(correlation) < WHITE + 3.0 / math.sqrt(len(residual))
