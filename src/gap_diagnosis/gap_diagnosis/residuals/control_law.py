"""The controller's law as records tell it: interfaces.md, "Servo controller".

What a controller reads (reference, encoder) and what it commands (velocity, force) are both in the
record, so that its gains can be fitted link by link, without the plant. Efforts with noise of
their own are compared as they are, as that noise is white in them; all others by their increments,
which hold no integral.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.optimize import minimize_scalar

from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import held_out_windows, inside
from gap_diagnosis.residuals.low_pass import band_limited
from stage_core.arrays import Array
from stage_core.twin_file import ServoAxis
from stage_twin.effects import shared

Mask = NDArray[np.bool_]
#: What is counted of increments (n,) or (n, k) on the ticks in use.
Rows = Callable[[Record, int, Array, Mask], Array]

#: Ticks that are fitted, below which no law is looked for.
LEAST_TICKS = 100
#: Hz, above which a record with noise beyond its encoder's steps is not asked: the controller may
#: have read another noise than the record holds, which two differences raise with f².
QUIET, EDGE = 25.0, 0.2  # Hz, and s at the ends that are left out
#: Share of what such noise makes up to which a law leaves so little that the controller did read
#: what is recorded. Of 241 axes of five simulators 237 left 4e-10 at most, the others 34 and more.
READ = 0.1
#: Correlation of neighbours below which what a law leaves of an effort is white noise of its own:
#: 0.01 of an effort with such noise, 0.16 and 0.19 where the signs of a magnitude are in doubt.
WHITE = 0.05
#: RMS that the twin's own corner of the filter, or its own gains beside white noise, may leave
#: over what the best law leaves.
NO_WORSE = 1.02
CORNER_STEP = 0.02  # of a filter's corner, as a share of it, for the curvature of what is left


@dataclass(frozen=True)
class Law:
    """Gains of one axis' controller, and what they leave of the recorded commands."""

    gains: ServoAxis
    deviations: dict[str, float]
    left: float  # RMS of the force increments that stay unexplained, of efforts where `noisy` [N]
    noisy: bool = False  # whether the effort has white noise of its own beside the law

    def error(self, nominal: ServoAxis, name: str) -> tuple[float, float]:
        """Error of a gain and its standard deviation, relative; of a feed-forward absolute."""
        own, base = float(getattr(self.gains, name)), float(getattr(nominal, name))
        scale = base if base > 0.0 and name != 'velocity_feedforward' else 1.0
        return (own - base) / scale, self.deviations.get(name, 0.0) / scale


def wrong(record: Record, i: int, axis: ServoAxis) -> Array:
    """Recorded force increments (n - 1,) less those of a law [N], which reads what is recorded."""
    expected = force_increments(record, i, axis, velocity_law(record, i, axis))
    return np.asarray(np.diff(record.force[:, i]) - expected)


def velocity_law(record: Record, i: int, axis: ServoAxis) -> Array:
    """vc_k (n,) [m/s] of a law; the recorded one in ticks whose set-point carries a velocity."""
    law = axis.position_gain * (record.reference[:, i] - record.encoder[:, i])
    law = law + axis.velocity_feedforward * np.nan_to_num(record.reference_velocity[:, i])
    recorded = record.velocity_command[:, i]
    return np.where(record.declared & np.isfinite(recorded), recorded, law)


def force_increments(record: Record, i: int, axis: ServoAxis, command: Array) -> Array:
    """F_k - F_(k-1) (n - 1,) [N] of the velocity loop; the start of its integral drops out."""
    error = command - filtered(record, i, axis.velocity_filter)
    return axis.velocity_gain * np.diff(error) + axis.integral_gain * record.period * error[:-1]


def quiet(record: Record, i: int, rows: Array) -> Array:
    """Rows (n,) or (n, k) of the linear law, without the frequencies at which noise rules."""
    noisy = record.noise is not None and record.noise.axes[i].beyond_steps
    return slow(record, rows) if noisy else rows


def slow(record: Record, rows: Array) -> Array:
    """Rows (n,) or (n, k) below the frequencies at which noise rules."""
    out = band_limited(rows, record.period, QUIET)
    # The filter starts on noise there.
    edge = int(round(EDGE / record.period))
    out[:edge] = out[-edge:] = 0.0
    return out


def filtered(record: Record, i: int, corner: float) -> Array:
    """vf_k (n,) [m/s], the controller's speed, for a corner of its filter [rad/s]."""
    q = record.encoder[:, i]
    decay = math.exp(-record.period * corner)
    rate = np.diff(q, prepend=q[0]) / record.period
    return shared.filtered([1.0 - decay], [1.0, -decay], rate)


def free(record: Record, i: int, axis: ServoAxis) -> Mask:
    """Increments (n - 1,) between ticks of which none is clipped, away from lost ticks.

    With noise beyond the encoder's steps none within the reach of `quiet` is: that would spread
    what follows no law.
    """
    clipped = np.abs(record.force[:, i]) >= 0.999 * axis.force_limit
    if clipped.any() and record.noise is not None and record.noise.axes[i].beyond_steps:
        clipped = maximum_filter1d(clipped, 2 * int(round(EDGE / record.period)) + 1)
    free = ~clipped & record.whole(record.time)
    free[: min(5, len(free))] = False
    return np.asarray(free[1:] & free[:-1])


def fit_law(records: list[Record], i: int, axis: ServoAxis) -> Law:
    """Least-squares gains of the law on the fit windows, link by link.

    Position loop: recorded velocity command against (ṙ, r - q). Velocity loop: recorded force
    increments against the increments and values of vc - vf, for the best corner of the filter; of
    an effort with noise of its own the sums of all these.
    """
    gains, deviations = position_loop(records, i, axis)
    if _reads(records, i, gains):
        law = _best_law(records, i, axis, gains, deviations, levels)
        if _is_white(np.concatenate(_unexplained(records, i, law.gains))):
            return replace(law, noisy=True)
    return _best_law(records, i, axis, gains, deviations, _increments)


def _best_law(
    records: list[Record],
    i: int,
    axis: ServoAxis,
    gains: ServoAxis,
    deviations: dict[str, float],
    rows: Rows,
) -> Law:
    """The law of an axis whose position loop is known, for the best corner of the filter."""

    def velocity_loop(corner: float) -> tuple[tuple[float, float], tuple[float, float], float]:
        return _velocity_loop(records, i, gains, corner, rows)

    corners = axis.velocity_filter * np.geomspace(0.1, 10.0, 25)
    costs = [velocity_loop(corner)[2] for corner in corners]
    at = int(np.argmin(costs))
    best = minimize_scalar(
        lambda z: velocity_loop(math.exp(z))[2],
        bounds=(math.log(corners[max(at - 1, 0)]), math.log(corners[min(at + 1, 24)])),
        method='bounded',
        options={'xatol': 1e-4},
    )
    corner = math.exp(float(best.x))
    # The twin's own corner is taken unless another one is clearly better.
    if velocity_loop(axis.velocity_filter)[2] <= NO_WORSE * float(best.fun):
        corner = axis.velocity_filter
    (gain, integral), (gain_std, integral_std), cost = velocity_loop(corner)
    gains = replace(
        gains, velocity_gain=gain, integral_gain=max(integral, 0.0), velocity_filter=corner
    )
    own = {'velocity_gain': gain_std, 'integral_gain': integral_std}
    if corner != axis.velocity_filter:
        ticks = sum(int(fit_ticks(r, i, axis).sum()) for r in records)
        step = CORNER_STEP * corner
        before, after = velocity_loop(corner - step), velocity_loop(corner + step)
        bend = before[2] ** 2 + after[2] ** 2 - 2.0 * cost**2
        if bend > 0.0:
            std = own['velocity_filter'] = step * cost * math.sqrt(2.0 / (ticks * bend))
            # What both gains follow of the corner's error.
            for k, name in enumerate(('velocity_gain', 'integral_gain')):
                slope = (after[0][k] - before[0][k]) / (2.0 * step)
                own[name] = math.hypot(own[name], slope * std)
    return Law(gains, deviations | own, cost)


def _reads(records: list[Record], i: int, gains: ServoAxis) -> bool:
    """Whether a controller read what is recorded: its position loop explains its commands."""
    rest, noise = [], 0.0
    for record in records:
        recorded = record.velocity_command[:, i]
        use = np.concatenate([[False], fit_ticks(record, i, gains)])
        use &= ~record.declared & np.isfinite(recorded)
        rest.append((recorded - velocity_law(record, i, gains))[use])
        noise = max(noise, 0.0 if record.noise is None else record.noise.axes[i].position)
    left = np.concatenate(rest)
    if len(left) < LEAST_TICKS:
        return False
    return float(np.sqrt(np.mean(left**2))) < READ * gains.position_gain * noise


def _unexplained(records: list[Record], i: int, axis: ServoAxis) -> list[Array]:
    """What a law leaves of efforts [N] on the ticks that fit, run by run."""
    return [levels(r, i, wrong(r, i, axis), fit_ticks(r, i, axis)) for r in records]


def _is_white(rows: Array) -> bool:
    """Whether neighbours among rows (n,) have nothing in common."""
    return bool(abs(np.mean(rows[1:] * rows[:-1])) < WHITE * np.mean(rows**2))


def levels(record: Record, i: int, rows: Array, use: Mask) -> Array:
    """Sums over each run of ticks in use of increments (n,) or (n, k), less their mean.

    Noise of an effort is white in them.
    """
    ends = np.flatnonzero(np.diff(use.astype(np.int8), prepend=0, append=0))
    runs = [np.cumsum(rows[a:b], axis=0) for a, b in ends.reshape(-1, 2)]
    return np.concatenate([rows[:0], *(run - run.mean(axis=0) for run in runs)])


def _increments(record: Record, i: int, rows: Array, use: Mask) -> Array:
    """Increments (n,) or (n, k) themselves, below the frequencies at which noise rules."""
    return quiet(record, i, rows)[use]


def fit_ticks(record: Record, i: int, axis: ServoAxis) -> Mask:
    """Those of `free` that fit (n - 1,)."""
    return free(record, i, axis) & ~inside(record.time, held_out_windows(record))[1:]


def position_loop(
    records: list[Record], i: int, axis: ServoAxis
) -> tuple[ServoAxis, dict[str, float]]:
    """Gains with the position loop of the recorded velocity commands, and its deviations."""
    rows, target = [], []
    for record in records:
        recorded = record.velocity_command[:, i]
        use = np.concatenate([[False], fit_ticks(record, i, axis)])
        use &= ~record.declared & np.isfinite(recorded)
        rate = np.nan_to_num(record.reference_velocity[:, i])
        error = record.reference[:, i] - record.encoder[:, i]
        rows.append(quiet(record, i, np.column_stack([error, rate]))[use])
        target.append(quiet(record, i, np.nan_to_num(recorded))[use])
    matrix, wanted = np.concatenate(rows), np.concatenate(target)
    if len(wanted) < LEAST_TICKS:
        return axis, {}
    (gain, feedforward), deviation, _ = _least_squares(matrix, wanted)
    names = ('position_gain', 'velocity_feedforward')
    return replace(axis, position_gain=gain, velocity_feedforward=feedforward), dict(
        zip(names, deviation, strict=True)
    )


def _velocity_loop(
    records: list[Record], i: int, axis: ServoAxis, corner: float, counted: Rows
) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Velocity and integral gain, their standard deviations, and the RMS that they leave [N]."""
    rows, target = [], []
    for record in records:
        recorded = record.velocity_command[:, i]
        command = np.where(np.isfinite(recorded), recorded, velocity_law(record, i, axis))
        error = command - filtered(record, i, corner)
        use = fit_ticks(record, i, axis)
        both = np.column_stack([np.diff(error), record.period * error[:-1]])
        rows.append(counted(record, i, both, use))
        target.append(counted(record, i, np.diff(record.force[:, i]), use))
    return _least_squares(np.concatenate(rows), np.concatenate(target))


def _least_squares(
    matrix: Array, target: Array
) -> tuple[tuple[float, float], tuple[float, float], float]:
    scale = np.linalg.norm(matrix, axis=0) + 1e-300
    solution, *_ = np.linalg.lstsq(matrix / scale, target, rcond=1e-9)
    rest = target - matrix / scale @ solution
    inverse = np.linalg.pinv((matrix / scale).T @ (matrix / scale))
    cost = math.sqrt(float(np.mean(rest**2)))
    deviation = cost * np.sqrt(np.maximum(np.diag(inverse), 0.0)) / scale
    values = solution / scale
    return (
        (float(values[0]), float(values[1])),
        (float(deviation[0]), float(deviation[1])),
        cost,
    )
