"""Reference and encoder -> force: does the recorded controller follow the twin's law?

A law with other gains is `controller_mismatch`; forces that stand at a limit below the twin's are
`force_saturation`.
"""

from __future__ import annotations

import math
from dataclasses import asdict, replace

import numpy as np

from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import held_out_windows, inside
from gap_diagnosis.parameters import Estimates
from gap_diagnosis.residuals.control_law import (
    LEAST_TICKS,
    NO_WORSE,
    READ,
    fit_law,
    fit_ticks,
    force_increments,
    free,
    levels,
    position_loop,
    quiet,
    slow,
    velocity_law,
    wrong,
)
from stage_core.twin_file import ServoAxis, TwinFile
from stage_twin import hooks
from stage_twin.effects import EFFECTS
from stage_twin.effects.definition import Effect

MISMATCH = EFFECTS['controller_mismatch']

#: Share that another law may leave of what the twin's does of the held-out increments of velocity
#: or force commands: above it are stored digits and interpolated ticks.
CLEARLY_BETTER = 0.5
#: Fields of the controller, link by link.
GAINS = (
    'position_gain',
    'velocity_feedforward',
    'velocity_gain',
    'integral_gain',
    'velocity_filter',
)
#: Times what such noise makes, below which no other law is looked for: its measured figure is the
#: mean of a noise that may go with the speed.
BEYOND_NOISE = 2.0
#: Share by which a gain must differ to be named. Recorded commands give it to 1e-14; a position
#: gain wrong by 0.018 makes a gap of forty times the floor, so that this share makes two.
LEAST_SHARE = 1e-3
#: Share of what the twin's law leaves of slow increments that other gains leave where they are all
#: that is different: 0.01 at most on nine axes, 0.16 where a gain grew with the error.
PARTLY = 0.05


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
    if _too_few(fitted, i, axis):
        return {}
    law = fit_law(fitted, i, axis)
    most, unexplained = (1.0 / NO_WORSE, beside_noise) if law.noisy else (CLEARLY_BETTER, left)
    nominal = unexplained(fitted, i, axis)
    least = 0.0 if law.noisy else BEYOND_NOISE * max(_of_noise(r, i, axis) for r in fitted)
    # Where every tick that judges is clipped it is not a number.
    if not nominal >= least or not 0.0 < nominal * most >= unexplained(fitted, i, law.gains):
        return {}
    # What else pushes in another session (pulses, a disturbance) no law explains.
    if held_out and unexplained(held_out, i, law.gains) >= unexplained(held_out, i, axis):
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

    Only slow increments are asked: those of an effort with noise are mostly its noise. Without it
    the encoder's noise makes what is left at most, if the controller did not read that.
    """
    fitted = [r for r in _as_read(records, i, axis) if not r.held_out_session]
    other = with_found(axis, MISMATCH, found)
    mine, its = (_slow(fitted, i, law) for law in (axis, other))
    noise = _slow_noise(fitted, i, other)
    if not fit_law(fitted, i, axis).noisy:
        noise = min(noise, max(_of_noise(r, i, other) for r in fitted))
    return its < math.hypot(PARTLY * mine, BEYOND_NOISE * noise)


def with_found(axis: ServoAxis, effect: Effect, found: Estimates) -> ServoAxis:
    """An axis whose controller an effect with these findings has changed."""
    fields = asdict(axis)
    hooks.prepare(effect, fields, effect.defaults() | {k: v for k, (v, _) in found.items()})
    return ServoAxis(**fields)


def _slow(records: list[Record], i: int, axis: ServoAxis) -> float:
    """RMS of the slow force increments that a law leaves [N]."""
    rows = [slow(r, np.where(free(r, i, axis), wrong(r, i, axis), 0.0)) for r in records]
    return math.sqrt(float(np.mean(np.concatenate(rows) ** 2)))


def _slow_noise(records: list[Record], i: int, axis: ServoAxis) -> float:
    """RMS of the slow force increments [N] if all that a law leaves were white noise."""
    squares = [wrong(r, i, axis)[free(r, i, axis)] ** 2 for r in records]
    effort = math.sqrt(0.5 * float(np.mean(np.concatenate(squares))))
    pulse = np.zeros(len(records[0].time))
    pulse[len(pulse) // 2] = effort
    return float(np.linalg.norm(slow(records[0], np.diff(pulse))))


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
    return sum(int(fit_ticks(r, i, axis).sum()) for r in records) < LEAST_TICKS


def left(records: list[Record], i: int, axis: ServoAxis) -> float:
    """RMS over the held-out ticks of the force increments that a law leaves unexplained [N].

    Both links count: the velocity command that the law gives stands in place of the recorded one.
    It is not a number where each of these ticks is clipped.
    """
    squares = []
    for record in records:
        mask = inside(record.time, held_out_windows(record))[1:] & free(record, i, axis)
        squares.append(quiet(record, i, wrong(record, i, axis))[mask] ** 2)
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


def beside_noise(records: list[Record], i: int, axis: ServoAxis) -> float:
    """RMS over the held-out ticks of the efforts that a law leaves unexplained [N]."""
    rest = []
    for record in records:
        mask = inside(record.time, held_out_windows(record))[1:] & free(record, i, axis)
        rest.append(levels(record, i, wrong(record, i, axis), mask))
    left = np.concatenate(rest)
    return float(np.sqrt(np.mean(left**2))) if left.size else math.nan


def is_plain(records: list[Record], i: int, axis: ServoAxis) -> bool:
    """Whether the velocity commands that set-points declare are those of a plain position loop."""
    records = [replace(r, setpoint_velocity=None) for r in records]
    gains, _ = position_loop(records, i, axis)
    rest, noise = [], 0.0
    for record in records:
        recorded = record.velocity_command[:, i]
        use = np.concatenate([[False], free(record, i, axis)]) & np.isfinite(recorded)
        rest.append((recorded - velocity_law(record, i, gains))[use])
        noise = max(noise, record.noise.axes[i].position if record.noise else 0.0)
    left = np.concatenate(rest)
    least = BEYOND_NOISE * gains.position_gain * noise
    return bool(left.size) and float(np.sqrt(np.mean(left**2))) < least
