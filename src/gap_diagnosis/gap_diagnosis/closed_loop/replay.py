"""Replay of a record with a twin: in closed loop, or with the recorded force as its input."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gap_diagnosis.closed_loop import dither
from gap_diagnosis.evidence.describe import model_of
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import Ticks, fitted_ticks
from gap_diagnosis.parameters import Effects
from gap_diagnosis.residuals.nominal import merged
from gap_diagnosis.residuals.recording import CONVENTION
from gap_diagnosis.residuals.search import Recent
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.quantities import split_effect
from stage_core.twin_file import ForceAxis, TwinFile
from stage_twin import hooks
from stage_twin.effects import link_of
from stage_twin.measured_force import simulate_measured_force, smooth_motion
from stage_twin.simulate import simulate_loop

AWAY = 1e9  # m or N
#: Draws of the encoders' noise whose squared gaps count by their mean where a friction holds an
#: axis. From draw to draw the gap of one machine was 0.58 to 0.89 µm.
DRAWS = 4
#: Runs that were made last (64 MiB): a third of all is asked for again, for other ticks or effects
#: that leave the machine as it is.
RUNS = Recent(1 << 26)


def declared_commands(record: Record, twin: TwinFile) -> Array:
    """What set-points with a velocity asked for beyond the nominal law, shape (n, a) [m/s].

    The contour controller's terms are known inputs of the replay. Whatever else the recorded
    controller did beyond the twin's law is part of the gap.
    """
    out = np.zeros_like(record.reference)
    ticks = record.declared
    for i, name in enumerate(record.axes):
        axis = twin.servo(name)
        law = axis.position_gain * (record.reference[:, i] - record.encoder[:, i])
        if axis.velocity_feedforward:
            law = law + axis.velocity_feedforward * record.reference_velocity[:, i]
        out[ticks, i] = (record.velocity_command[:, i] - law)[ticks]
    # Rounding of stored numbers is no command.
    out[np.abs(out) < 1e-9] = 0.0
    return out


def replay(
    record: Record, twin: TwinFile, effects: Effects, draw: int | None = 0
) -> dict[str, Array]:
    """Gap (n,) of each encoder channel [m] and of the force of each axis [N].

    A servo twin follows the recorded reference with its own controller (closed loop). Where it
    has a friction its encoders have a `draw` of the measured noise, none for None (`dither`). A
    measured-force twin runs in windows of 100 ms from the recorded state. A stepper
    twin has no encoder that could show a gap. Beside a simulator's run the gap is
    (real - simulated) less what the effects add to the twin. An axis whose force nothing tells has
    no gap: no gains run it.
    """
    gaps = _replay(record, twin, effects, draw)
    return {
        name: _finite(gap + record.offset.get(name, 0.0))
        for name, gap in gaps.items()
        if split_effect(name)[1] not in record.untold
    }


def replays(
    record: Record, twin: TwinFile, effects: Effects, draws: int = DRAWS
) -> list[dict[str, Array]]:
    """Gaps as of `replay`, of some draws of the noise where the loop hangs on it."""
    own = [n for n in (*twin.effects, *effects) if split_effect(n)[1] in (None, *record.axes)]
    shaken = twin.kind == 'servo' and dither.sticks(own) and dither.shakes(record)
    return [replay(record, twin, effects, draw) for draw in range(draws if shaken else 1)]


def of_axis(record: Record, twin: TwinFile, effects: Collection[str], axis: str) -> Record:
    """The record of one axis, where no effect of the twin or of `effects` couples the axes."""
    if any(hooks.couples(split_effect(name)[0]) for name in (*twin.effects, *effects)):
        return record
    return _one_axis(record, axis)


def _one_axis(record: Record, axis: str) -> Record:
    """A record of one axis alone, without tracker."""
    i = record.column(axis)
    columns = {
        name: getattr(record, name)[:, [i]]
        for name in (
            'reference',
            'reference_velocity',
            'velocity_command',
            'force',
            'encoder',
        )
    }
    warm = None if record.temperature is None else record.temperature[:, [i]]
    noise = record.noise and replace(record.noise, axes=(record.noise.axes[i],))
    return replace(
        record,
        axes=(axis,),
        noise=noise,
        moving=(record.moving[i],),
        temperature=warm,
        tracker=None,
        tracker_time=None,
        **columns,
    )


def mean_square(runs: Sequence[Mapping[str, Array]], channel: str) -> Array:
    """Squared gap (n,) of a channel, mean over the runs."""
    return np.asarray(np.mean([run[channel] ** 2 for run in runs], axis=0))


def replayed_gap(
    records: Iterable[Record],
    twin: TwinFile,
    effects: Effects,
    axis: str,
    ticks: Ticks,
    draws: int = DRAWS,
) -> float:
    """RMS [m] of the gap of an encoder on some ticks; infinite where no machine could run."""
    try:
        runs = [
            (replays(of_axis(r, twin, effects, axis), twin, effects, draws), ticks(r))
            for r in records
        ]
        squares = [mean_square(own, f'encoder.{axis}')[rows] for own, rows in runs]
    except StageError:
        return math.inf
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def fitted_gap(
    records: Iterable[Record],
    twin: TwinFile,
    effects: Effects,
    axis: str,
    draws: int = DRAWS,
    ticks: Ticks = fitted_ticks,
) -> float:
    """RMS [m] of the gap of an encoder on the ticks to which the loop is fitted."""
    fitted = [record for record in records if not record.held_out_session]
    return replayed_gap(fitted, twin, effects, axis, ticks, draws)


def _finite(gap: Array) -> Array:
    """A gap (n,) whose squares can be summed: a run that diverges is `AWAY` far."""
    return np.clip(np.nan_to_num(gap, nan=AWAY), -AWAY, AWAY)


def _replay(
    record: Record, twin: TwinFile, effects: Effects, draw: int | None
) -> dict[str, Array]:
    if twin.kind == 'stepper':
        return {}
    mine = {
        name: dict(values)
        for name, values in effects.items()
        if split_effect(name)[1] in record.axes
        and (link_of(name) == 'servo' or name.startswith('encoder'))
    }
    machine = replace(twin, axes={a: twin.axes[a] for a in record.axes}, tracker=None)
    own = {
        n: v
        for n, v in twin.effects.items()
        if split_effect(n)[1] in (None, *record.axes) and split_effect(n)[0] != CONVENTION
    }
    machine = merged(replace(machine, effects={**own, **_dry(record, own)}), mine)
    if twin.kind == 'measured_force':
        units = [axis.effort_unit for axis in machine.axes.values() if isinstance(axis, ForceAxis)]
        result = simulate_measured_force(machine, record.encoder, record.force / np.array(units))
        # The needed force follows from a smoothed motion: the recorded one is smoothed alike.
        force = smooth_motion(result.force, record.period).position
        return by_channel(record.axes, record.encoder - result.encoder, force - result.required)
    commands, encoder, force = declared_commands(record, twin), record.encoder, record.force
    if draw is not None and dither.sticks(machine.effects):
        commands = commands + dither.shaking(record, twin, draw)
        moved, pushed = dither.answer(record, twin, draw)
        encoder, force = encoder + moved, force + pushed
    velocity = np.nan_to_num(record.reference_velocity, nan=0.0)
    run = repr(machine), record.reference.tobytes(), velocity.tobytes(), commands.tobytes()
    simulated = RUNS.once(
        hash(run),
        lambda: np.stack(simulate_loop(machine, record.reference, velocity, commands)),
    )
    return by_channel(record.axes, encoder - simulated[0], force - simulated[1])


def _dry(record: Record, stated: Effects) -> dict[str, dict[str, float]]:
    """Frictions that the twin states, without presliding where the machine rests so."""
    if record.noise is None:
        return {}
    dry = [a for a, own in zip(record.axes, record.noise.axes, strict=True) if own.dry]
    return {
        n: {**v, 'presliding': 0.0}
        for n, v in stated.items()
        if model_of(n) == 'friction' and split_effect(n)[1] in dry
    }


def by_channel(axes: tuple[str, ...], encoder: Array, force: Array) -> dict[str, Array]:
    """Columns (n,) of both (n, a), by the names of their channels."""
    signals = {'encoder': encoder, 'force': force}
    return {f'{n}.{axis}': s[:, i] for n, s in signals.items() for i, axis in enumerate(axes)}
