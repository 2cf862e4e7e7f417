"""The law of a drive's velocity loop: its force from command and encoder."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gap_diagnosis.input.data import Record
from gap_diagnosis.residuals.control_law import filtered, velocity_law
from gap_diagnosis.residuals.low_pass import smooth
from gap_diagnosis.residuals.operators import central_difference
from stage_core.arrays import Array
from stage_core.twin_file import ServoAxis

SLOW = 5.0  # Hz, below which the following error tells the position gain


@dataclass(frozen=True)
class DriveLaw:
    """Gains of an axis' controller, as a session without forces shows them.

    Attributes
    ----------
    gains : newtons are those for the twin's mass
    left, share : RMS [N] that the law leaves with the effect beside it, and its share of the whole
    deviation : relative standard deviation of the velocity gain, which every force has, too
    known : whether that is no more than noise; else the servo link of the axis is not judged
    """

    gains: ServoAxis
    left: float
    share: float
    deviation: float
    known: bool


def errors_of(record: Record, i: int, gains: ServoAxis) -> Array:
    """Error of the velocity [m/s] and its integral [m], both at every tick, shape (n, 2)."""
    command = record.velocity_command[:, i]
    if not np.isfinite(command).all():
        command = velocity_law(record, i, gains)
    error = command - filtered(record, i, gains.velocity_filter)
    integral = np.concatenate([[0.0], np.cumsum(error)[:-1]]) * record.period
    return np.column_stack([error, integral])


def apart(record: Record, i: int, corner: float) -> Array:
    """Following error [m], less the speed [m/s], and the integrals of both, shape (n, 4)."""
    error = record.reference[:, i] - record.encoder[:, i]
    both = np.column_stack([error, -filtered(record, i, corner)])
    integral = np.cumsum(both, axis=0) - both
    return np.hstack([both, integral * record.period])


def force_of(record: Record, i: int, gains: ServoAxis) -> Array:
    """Force (n,) [N] of a law that nothing limits."""
    errors = errors_of(record, i, gains)
    force = errors @ np.array([gains.velocity_gain, gains.integral_gain])
    if float(np.abs(force).max()) <= gains.force_limit:
        return np.asarray(force)
    return _clipped(errors[:, 0], gains, record.period)


def _clipped(errors: Array, gains: ServoAxis, period: float) -> Array:
    """Force (n,) [N] of a law with a limit; its integral is held where it would go beyond."""
    limit, own, rise = gains.force_limit, gains.velocity_gain, gains.integral_gain * period
    out, integral = np.empty_like(errors), 0.0
    for k, error in enumerate(errors.tolist()):
        wanted = own * error + integral
        out[k] = min(max(wanted, -limit), limit)
        if not (wanted > limit and error > 0.0 or wanted < -limit and error < 0.0):
            integral += rise * error
    return out


def followed(records: list[Record], i: int, axis: ServoAxis) -> ServoAxis:
    """Gains with the position loop that the following error shows: v ≈ K (r − q) + k ṙ."""
    rows, speed = [], []
    for record in records:
        error = record.reference[:, i] - record.encoder[:, i]
        rate = central_difference(record.reference[:, i], record.period)
        pairs = np.column_stack([error, rate])
        rows.append(smooth(pairs, record.period, SLOW))
        own = central_difference(record.encoder[:, i], record.period)
        speed.append(smooth(own, record.period, SLOW))
    matrix, wanted = np.concatenate(rows), np.concatenate(speed)
    gain = float(matrix[:, 0] @ wanted / (matrix[:, 0] @ matrix[:, 0]))
    return replace(axis, position_gain=gain, velocity_feedforward=0.0)
