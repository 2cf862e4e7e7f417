"""A simulator's run of the same command in place of the twin's prediction.

The gap is real - simulated. Effects are judged as ever: the simulator's own remainder of the force
balance and of the tracker is taken out of the machine's, so that what is left is what that
simulator lacks. The twin says only what an effect adds: (twin with it) - (twin without).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.closed_loop.replay import by_channel, replay
from gap_diagnosis.input.data import Record, load_record
from gap_diagnosis.residuals.commands import controller_findings
from gap_diagnosis.residuals.controller import with_found
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.quantities import split_effect
from stage_core.session import Session
from stage_core.twin_file import TwinFile
from stage_twin.effects import EFFECTS

#: Least share of a session that the simulator has to run.
COVERED = 0.8


def of_simulator(twin: TwinFile, sessions: Sequence[Session]) -> TwinFile:
    """The rig with the gains that the simulator's controller really has, and without effects.

    Its effects are the simulator's affair: what they did is in its bag.

    Raises
    ------
    StageError
        If the twin is no servo twin, or a session of the simulator cannot be read.
    """
    if twin.kind != 'servo':
        raise StageError(f'--sim-bag needs a twin of kind servo, this one is {twin.kind}')
    plain = replace(twin, effects={})
    found, _ = controller_findings([load_record(s, plain) for s in sessions], plain)
    axes = dict(plain.axes)
    for name, values in found.items():
        effect, axis = split_effect(name)
        axes[axis or ''] = with_found(plain.servo(axis or ''), EFFECTS[effect], values)
    return replace(plain, axes=axes)


def beside(record: Record, simulated: Record, twin: TwinFile) -> Record:
    """The record with a simulator's run on its ticks.

    Raises
    ------
    StageError
        If the two did not run the same command, or hardly overlap.
    """
    shift = _shift(record, simulated)
    at = np.arange(len(record.time)) + shift
    there = (at >= 0) & (at < len(simulated.time))
    at = np.clip(at, 0, len(simulated.time) - 1)
    _check_same(record, simulated, at, there)
    run = replace(
        simulated,
        time=record.time,
        tracker_time=_moved(simulated, record, shift),
        **{name: getattr(simulated, name)[at] for name in ('encoder', 'force', 'reference')},
    )
    out = replace(
        record,
        simulated=run,
        gaps=(*record.gaps, *_stretches(record.time, ~there)),
        tracker=_tracker(record, run),
    )
    twins = replay(out, twin, {})
    own = by_channel(out.axes, out.encoder - run.encoder, out.force - run.force)
    return replace(out, offset={name: own[name] - gap for name, gap in twins.items()})


def _shift(record: Record, simulated: Record) -> int:
    """Ticks by which the simulator's count is ahead of the record's."""
    from scipy.signal import correlate

    axis = int(np.argmax(np.ptp(record.reference, axis=0)))
    ours, theirs = (np.diff(r.reference[:, axis]) for r in (record, simulated))
    return int(np.argmax(correlate(theirs, ours, method='fft'))) - (len(ours) - 1)


def _check_same(
    record: Record, simulated: Record, at: NDArray[np.int64], there: NDArray[np.bool_]
) -> None:
    if np.mean(there) < COVERED:
        raise StageError(
            f'{simulated.name} covers {100 * np.mean(there):.0f} % of {record.name}: simulate the '
            'whole command'
        )
    apart = (record.reference - simulated.reference[at])[there & record.whole(record.time)]
    rms = float(np.sqrt(np.mean(apart**2)))
    step = max(n.quantum for n in record.noise.axes) if record.noise else 1e-6
    if rms > step:
        raise StageError(
            f'{simulated.name} did not run the command of {record.name}: the references differ by '
            f'{1e6 * rms:.3g} µm RMS; give the simulator the recorded /stage/reference'
        )


def _moved(simulated: Record, record: Record, shift: int) -> Array | None:
    """Times of the simulator's tracker points on the record's clock [s]."""
    if simulated.tracker_time is None:
        return None
    begin = simulated.time[0] + shift * simulated.period
    return np.asarray(simulated.tracker_time - begin + record.time[0])


def _stretches(time: Array, missing: NDArray[np.bool_]) -> list[tuple[float, float]]:
    ends = np.flatnonzero(np.diff(missing.astype(int), prepend=0, append=0))
    last = len(time) - 1
    return [(float(time[a]), float(time[min(b, last)])) for a, b in ends.reshape(-1, 2)]


def _tracker(record: Record, run: Record) -> Array | None:
    """Tracker points (m, a) [m] less what the simulator's tracker shows beside its encoder."""
    if record.tracker is None or record.tracker_time is None:
        return None
    if run.tracker is None or run.tracker_time is None:
        return record.tracker
    shown = run.tracker - run.encoder_at(run.tracker_time)
    columns = [np.interp(record.tracker_time, run.tracker_time, column) for column in shown.T]
    return np.asarray(record.tracker - np.column_stack(columns))


def with_simulated(twin: TwinFile, records: Sequence[Record]) -> TwinFile:
    """The twin whose noise holds the simulator's, too: a difference has that of both."""
    first = records[0].simulated
    if first is None or first.noise is None:
        return twin
    axes, tracker = dict(twin.axes), twin.tracker
    for axis, noise in zip(first.axes, first.noise.axes, strict=True):
        own = twin.servo(axis)
        step = float(np.hypot(own.encoder_resolution, noise.step))
        axes[axis] = replace(own, encoder_resolution=step)
    if tracker is not None and first.noise.tracker is not None:
        tracker = replace(tracker, noise=float(np.hypot(tracker.noise, first.noise.tracker)))
    return replace(twin, axes=axes, tracker=tracker)
