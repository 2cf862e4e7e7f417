"""Reference and encoder -> force: does the recorded controller follow the twin's law?

What the controller reads (reference, encoder) and what it commands (velocity, force) are both in
the record, so that its law can be fitted link by link, without the plant and without noise:
interfaces.md, "Servo controller". A law with other gains is `controller_mismatch`; forces
that stand at a limit below the twin's are `force_saturation`.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import held_out_windows, inside
from gap_diagnosis.parameters import Estimates
from gap_diagnosis.residuals.operators import band_limited
from stage_core.twin_file import ServoAxis, TwinFile
from stage_twin import hooks
from stage_twin.effects import EFFECTS
from stage_twin.effects.definition import Effect

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
MISMATCH = EFFECTS['controller_mismatch']

#: Share of the held-out increments of velocity or force commands that another law must explain
#: beyond the twin's: below it are stored digits and interpolated ticks.
CLEARLY_BETTER = 0.5
#: Ticks that are fitted, below which no law is looked for.
LEAST_TICKS = 100
#: Fields of the controller, link by link.
GAINS = (
    'position_gain',
    'velocity_feedforward',
    'velocity_gain',
    'integral_gain',
    'velocity_filter',
)
#: Hz, above which a record with noise beyond its encoder's steps is not asked: the controller may
#: have read another noise than the record holds, which two differences raise with f².
QUIET, EDGE = 25.0, 0.2  # Hz, and s at the ends that are left out
#: Times what such noise makes, below which no other law is looked for: its measured figure is the
#: mean of a noise that may go with the speed.
BEYOND_NOISE = 2.0
#: Share of what such noise makes up to which a law leaves so little that the controller did read
#: what is recorded. Of 241 axes of five simulators 237 left 4e-10 at most, the others 34 and more.
READ = 0.1
#: Share by which a gain must differ to be named. Recorded commands give it to 1e-14; a position
#: gain wrong by 0.018 makes a gap of forty times the floor, so that this share makes two.
LEAST_SHARE = 1e-3
#: Share of what the twin's law leaves of slow increments that other gains leave where they are all
#: that is different: 0.01 at most on nine axes, 0.16 where a gain grew with the error.
PARTLY = 0.05


@dataclass(frozen=True)
class Law:
    """Gains of one axis' controller, and what they leave of the recorded commands."""

    gains: ServoAxis
    deviations: dict[str, float]
    left: float  # RMS of the force increments that stay unexplained [N]

    def error(self, nominal: ServoAxis, name: str) -> tuple[float, float]:
        """Error of a gain and its standard deviation, relative; of a feed-forward absolute."""
        own, base = float(getattr(self.gains, name)), float(getattr(nominal, name))
        scale = base if base > 0.0 and name != 'velocity_feedforward' else 1.0
        return (own - base) / scale, self.deviations.get(name, 0.0) / scale


def with_read_gains(records: list[Record], twin: TwinFile) -> TwinFile:
    """The twin with the gains that the recorded commands have, for a file that states none."""
    axes = dict(twin.axes)
    fitted = [r for r in records if not r.held_out_session]
    for i, name in enumerate(records[0].axes):
        peak = max(float(np.abs(r.force[:, i]).max()) for r in records)
        own = replace(twin.servo(name), force_limit=max(twin.servo(name).force_limit, 2.0 * peak))
        axes[name] = fit_law(fitted, i, own).gains if any(r.moving[i] for r in fitted) else own
    return replace(twin, axes=axes, gains_stated=True)


def mismatch(records: list[Record], i: int, axis: ServoAxis) -> Estimates:
    """`controller_mismatch` of an axis; empty where its commands follow the twin's law."""
    records = _as_read(records, i, axis)
    fitted = [r for r in records if not r.held_out_session]
    held_out = [r for r in records if r.held_out_session]
    nominal = left(fitted, i, axis)
    # Where every tick that judges is clipped it is not a number.
    if not nominal >= BEYOND_NOISE * max(_of_noise(r, i, axis) for r in fitted):
        return {}
    if _too_few(fitted, i, axis):
        return {}
    law = fit_law(fitted, i, axis)
    if nominal <= 0.0 or left(fitted, i, law.gains) > (1.0 - CLEARLY_BETTER) * nominal:
        return {}
    # What else pushes in another session (pulses, a disturbance) no law explains.
    if held_out and left(held_out, i, law.gains) >= left(held_out, i, axis):
        return {}
    out: Estimates = {}
    for name in GAINS:
        value, deviation = law.error(axis, name)
        stated = MISMATCH.parameter(f'{name}_error')
        if not stated.minimum <= value <= stated.maximum:
            return {}  # no controller: something else makes these forces
        if abs(value) > max(LEAST_SHARE, 3.0 * deviation):
            out[stated.name] = (value, deviation)
    return out


def follows(records: list[Record], i: int, axis: ServoAxis, found: Estimates) -> bool:
    """Whether the commands of an axis follow the twin's law with other gains (`mismatch`).

    Only slow increments are asked: those of an effort with noise are mostly its noise.
    """
    fitted = [r for r in _as_read(records, i, axis) if not r.held_out_session]
    other = with_found(axis, MISMATCH, found)
    mine, its = (_slow(fitted, i, law) for law in (axis, other))
    return its < math.hypot(PARTLY * mine, BEYOND_NOISE * _slow_noise(fitted, i, other))


def with_found(axis: ServoAxis, effect: Effect, found: Estimates) -> ServoAxis:
    """An axis whose controller an effect with these findings has changed."""
    fields = asdict(axis)
    hooks.prepare(effect, fields, effect.defaults() | {k: v for k, (v, _) in found.items()})
    return ServoAxis(**fields)


def _slow(records: list[Record], i: int, axis: ServoAxis) -> float:
    """RMS of the slow force increments that a law leaves [N]."""
    rows = [slow(r, np.where(_free(r, i, axis), _wrong(r, i, axis), 0.0)) for r in records]
    return math.sqrt(float(np.mean(np.concatenate(rows) ** 2)))


def _slow_noise(records: list[Record], i: int, axis: ServoAxis) -> float:
    """RMS of the slow force increments [N] if all that a law leaves were white noise."""
    squares = [_wrong(r, i, axis)[_free(r, i, axis)] ** 2 for r in records]
    effort = math.sqrt(0.5 * float(np.mean(np.concatenate(squares))))
    pulse = np.zeros(len(records[0].time))
    pulse[len(pulse) // 2] = effort
    return float(np.linalg.norm(slow(records[0], np.diff(pulse))))


def _wrong(record: Record, i: int, axis: ServoAxis) -> Array:
    """Recorded force increments (n - 1,) less those of a law [N], which reads what is recorded."""
    expected = force_increments(record, i, axis, velocity_law(record, i, axis))
    return np.asarray(np.diff(record.force[:, i]) - expected)


def _as_read(records: list[Record], i: int, axis: ServoAxis) -> list[Record]:
    """The records without noise of their own where the controller read what they hold."""
    fitted = [replace(r, noise=None) for r in records if not r.held_out_session]
    noisy = max((_of_noise(r, i, axis) for r in records if not r.held_out_session), default=0.0)
    if noisy == 0.0 or _too_few(fitted, i, axis):
        return records
    unexplained = left(fitted, i, fit_law(fitted, i, axis).gains)
    return [replace(r, noise=None) for r in records] if unexplained < READ * noisy else records


def _too_few(records: list[Record], i: int, axis: ServoAxis) -> bool:
    """Whether there are too few ticks to fit a law to."""
    return sum(int(_fit_ticks(r, i, axis).sum()) for r in records) < LEAST_TICKS


def left(records: list[Record], i: int, axis: ServoAxis) -> float:
    """RMS over the held-out ticks of the force increments that a law leaves unexplained [N].

    Both links count: the velocity command that the law gives stands in place of the recorded one.
    It is not a number where each of these ticks is clipped.
    """
    squares = []
    for record in records:
        mask = inside(record.time, held_out_windows(record))[1:] & _free(record, i, axis)
        squares.append(quiet(record, i, _wrong(record, i, axis))[mask] ** 2)
    counted = np.concatenate(squares)
    return math.sqrt(float(np.mean(counted))) if counted.size else math.nan


def _of_noise(record: Record, i: int, axis: ServoAxis) -> float:
    """RMS of the force increments [N] that noise of the record makes, if nobody else read it."""
    noise = None if record.noise is None else record.noise.axes[i]
    if noise is None or not noise.beyond_steps:
        return 0.0
    still = np.zeros_like(record.encoder)
    pulse = still.copy()
    pulse[len(pulse) // 2, i] = noise.std(np.diff(record.encoder[:, i]) / record.period)
    alone = replace(
        record, encoder=pulse, reference=still, reference_velocity=still, setpoint_velocity=None
    )
    made = force_increments(alone, i, axis, velocity_law(alone, i, axis))
    return float(np.linalg.norm(quiet(record, i, made)))


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
    return np.asarray(lfilter([1.0 - decay], [1.0, -decay], rate))


def _free(record: Record, i: int, axis: ServoAxis) -> Mask:
    """Increments (n - 1,) between ticks of which none is clipped, away from lost ticks.

    Where `quiet` filters, none within its reach is: it would spread what follows no law.
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
    increments against the increments and values of vc - vf, for the best corner of the filter.
    """
    gains, deviations = position_loop(records, i, axis)
    corners = axis.velocity_filter * np.geomspace(0.1, 10.0, 25)
    costs = [_velocity_loop(records, i, gains, corner)[2] for corner in corners]
    at = int(np.argmin(costs))
    best = minimize_scalar(
        lambda z: _velocity_loop(records, i, gains, math.exp(z))[2],
        bounds=(math.log(corners[max(at - 1, 0)]), math.log(corners[min(at + 1, 24)])),
        method='bounded',
        options={'xatol': 1e-4},
    )
    corner = math.exp(float(best.x))
    # The twin's own corner is taken unless another one is clearly better.
    if _velocity_loop(records, i, gains, axis.velocity_filter)[2] <= 1.02 * float(best.fun):
        corner = axis.velocity_filter
    (gain, integral), (gain_std, integral_std), cost = _velocity_loop(records, i, gains, corner)
    gains = replace(
        gains, velocity_gain=gain, integral_gain=max(integral, 0.0), velocity_filter=corner
    )
    deviations.update(velocity_gain=gain_std, integral_gain=integral_std)
    return Law(gains, deviations, cost)


def _fit_ticks(record: Record, i: int, axis: ServoAxis) -> Mask:
    return _free(record, i, axis) & ~inside(record.time, held_out_windows(record))[1:]


def position_loop(
    records: list[Record], i: int, axis: ServoAxis
) -> tuple[ServoAxis, dict[str, float]]:
    """Gains with the position loop of the recorded velocity commands, and its deviations."""
    rows, target = [], []
    for record in records:
        recorded = record.velocity_command[:, i]
        use = np.concatenate([[False], _fit_ticks(record, i, axis)])
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


def is_plain(records: list[Record], i: int, axis: ServoAxis) -> bool:
    """Whether the velocity commands that set-points declare are those of a plain position loop."""
    records = [replace(r, setpoint_velocity=None) for r in records]
    gains, _ = position_loop(records, i, axis)
    rest, noise = [], 0.0
    for record in records:
        recorded = record.velocity_command[:, i]
        free = np.concatenate([[False], _free(record, i, axis)]) & np.isfinite(recorded)
        rest.append((recorded - velocity_law(record, i, gains))[free])
        noise = max(noise, record.noise.axes[i].position if record.noise else 0.0)
    left = np.concatenate(rest)
    least = BEYOND_NOISE * gains.position_gain * noise
    return bool(left.size) and float(np.sqrt(np.mean(left**2))) < least


def _velocity_loop(
    records: list[Record], i: int, axis: ServoAxis, corner: float
) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Velocity and integral gain, their standard deviations, and the RMS that they leave [N]."""
    rows, target = [], []
    for record in records:
        recorded = record.velocity_command[:, i]
        command = np.where(np.isfinite(recorded), recorded, velocity_law(record, i, axis))
        error = command - filtered(record, i, corner)
        use = _fit_ticks(record, i, axis)
        both = np.column_stack([np.diff(error), record.period * error[:-1]])
        rows.append(quiet(record, i, both)[use])
        target.append(quiet(record, i, np.diff(record.force[:, i]))[use])
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
