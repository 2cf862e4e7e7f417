"""From a session to the arrays of a diagnosis."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from gap_diagnosis.input.checks import (
    check_excitation,
    check_forces,
    check_tracker_moves,
    check_units,
    finite,
    least_travel,
)
from gap_diagnosis.input.driven_wave import driven_wave
from gap_diagnosis.input.grid import Grid, control_period
from gap_diagnosis.input.noise import (
    Noise,
    axis_noise,
    encoder_step,
    sampling_jitter,
    tracker_noise,
    white_part,
)
from gap_diagnosis.input.reading_wave import MISREADS, reading_wave, without_wave
from gap_diagnosis.input.ticks import Clock
from gap_diagnosis.input.windows import LAST_THIRD, inside
from gap_diagnosis.parameters import Parameters, plain_values
from stage_core import topics
from stage_core.arrays import Array
from stage_core.clocks import to_seconds
from stage_core.errors import StageError
from stage_core.session import Series, Session
from stage_core.twin_file import StepperAxis, TwinFile, nominal_mass

if TYPE_CHECKING:
    from gap_diagnosis.input.coarse import Coarse

Mask = NDArray[np.bool_]

#: s before and after a stretch of lost ticks in which nothing is judged: the low-pass looks as far
#: ahead, the replayed loop takes as long to forget.
BEFORE_GAP, AFTER_GAP = 0.05, 0.25


@dataclass(frozen=True)
class Record:
    """One session on the regular grid of control ticks; positions [m], forces [N].

    Arrays of shape (n, a) have one column per axis of `axes`; tracker arrays have m rows.
    """

    name: str
    axes: tuple[str, ...]
    period: float
    time: Array
    reference: Array
    reference_velocity: Array
    velocity_command: Array
    force: Array
    encoder: Array
    temperature: Array | None
    tracker_time: Array | None
    tracker: Array | None
    held_out_session: bool = False
    windows_at: float = LAST_THIRD  # of a block of time, where its held-out window begins
    moving: tuple[bool, ...] = ()
    warnings: tuple[str, ...] = field(default=())
    row_noise: float | None = None  # of the mean of a rest's points [m]; None for single points
    rest_scatter: float | None = None  # standard deviation of repeated rests [m]
    clock: Clock | None = None  # from stamps to `time`; None where they are the same
    tracker_stamp: Array | None = None  # of the points, where `clock` makes another time of it
    frame: Coarse | None = None  # of the nominal twin's tracker, taken out of the points
    coarse: Coarse | None = None  # what was taken out of them after that
    #: Ticks (n,) whose set-point carried a velocity: what it asks for is a known input.
    setpoint_velocity: Mask | None = None
    gaps: tuple[tuple[float, float], ...] = ()  # stretches of `time` [s] without any ticks
    #: What the encoders by themselves show of `encoder_interpolation`, by its name with the axis.
    waves: Parameters = field(default_factory=dict)
    noise: Noise | None = None  # measured; None where the ticks are no samples of a motion
    #: A simulator's run of the same command on these ticks; by channel, twin minus that run.
    simulated: Record | None = None
    offset: Mapping[str, Array] = field(default_factory=dict)
    #: Whether the force is recorded; else `force` is what the drive's own law gives.
    effort_recorded: bool = True
    #: Axes whose force nothing tells: no law of the drive was found in place of the record.
    untold: tuple[str, ...] = ()

    @property
    def duration(self) -> float:
        """Length of the session [s]."""
        return float(self.time[-1] - self.time[0] + self.period)

    @cached_property
    def _path(self) -> CubicSpline:
        return CubicSpline(self.time, self.encoder)

    def encoder_at(self, time: Array) -> Array:
        """Encoder (m, a) [m] at any times (m,) [s] of the session, a cubic spline of the ticks.

        A straight line between ticks would leave a T²/8 of an acceleration a: at 10 m/s² and 1 ms
        more than an encoder step of 1 µm. A spline leaves (ω T)⁴/384 of a motion of frequency ω.
        """
        return np.asarray(self._path(np.clip(time, self.time[0], self.time[-1])))

    def motion(self, column: int) -> Array:
        """Positions (n,) [m] of an axis, as far as its own readings tell their wave."""
        wave = plain_values(self.waves).get(f'{MISREADS}.{self.axes[column]}')
        position = self.encoder[:, column]
        return position if wave is None else without_wave(position, self.period, wave)

    def point_time(self, latency: float = 0.0, drift: float = 0.0) -> Array:
        """Machine's time (m,) [s] of the tracker points, their stamps late or drifting."""
        stamps = self.tracker_time if self.tracker_stamp is None else self.tracker_stamp
        assert stamps is not None
        true = stamps / (1.0 + drift) - latency
        return true if self.clock is None else self.clock.to_machine(true)

    def session_time(self, time: float) -> float:
        """Time by the stamps since the session's start [s] of a time of the machine [s]."""
        return time if self.clock is None else float(self.clock.to_stamps(np.array([time]))[0])

    @property
    def declared(self) -> Mask:
        """Ticks (n,) whose velocity command is an input that a set-point declared."""
        if self.setpoint_velocity is None:
            return np.zeros(len(self.time), dtype=bool)
        return self.setpoint_velocity

    def whole(self, time: Array) -> Mask:
        """Which of the times (n,) [s] are far from stretches of lost ticks."""
        near = [(a - BEFORE_GAP, b + AFTER_GAP) for a, b in self.gaps]
        return ~inside(time, near)

    def column(self, axis: str) -> int:
        """Column of an axis in the arrays."""
        return self.axes.index(axis)


def motion_step(twin: TwinFile, axis: str) -> float:
    """Least step of the recorded motion of an axis [m]: of the encoder, or of the motor."""
    own = twin.axes[axis]
    return own.microstep if isinstance(own, StepperAxis) else own.encoder_resolution


def known_axes(session: Session, twin: TwinFile) -> tuple[str, ...]:
    """Axes of a session.

    Raises
    ------
    StageError
        If the twin lacks one of them.
    """
    absent = [axis for axis in session.axes if axis not in twin.axes]
    if absent:
        raise StageError(
            f'the twin has no axis {absent[0]} but {session.path} has: give the twin file of '
            'this machine'
        )
    return session.axes


def load_record(session: Session, twin: TwinFile, held_out: bool = False) -> Record:
    """Arrays of a session, checked against the twin that is to explain it.

    Raises
    ------
    StageError
        If a topic is missing, holds NaNs or does not overlap the others in time, if the twin
        belongs to another machine, or if the session lacks excitation.
    """
    axes = known_axes(session, twin)
    reference, states = (
        finite(session.require(topic, why), session.path)
        for topic, why in (
            (topics.REFERENCE, 'says what was asked for'),
            (topics.JOINT_STATES, 'holds the encoders'),
        )
    )
    recorded = has_effort(session, axes) or twin.kind != 'servo'
    command = _commands(session, axes, recorded)
    start = session.start_ns
    period = control_period(reference, twin.control_period, session.path)
    resolution = np.array([motion_step(twin, axis) for axis in axes])
    series = (reference, states) if command is None else (reference, command, states)
    grid = Grid(start, period, series, axes, resolution, session.path)
    effort_unit = np.array([getattr(twin.axes[axis], 'effort_unit', 1.0) for axis in axes])
    encoder = grid.positions(states, axes)
    nothing = np.full_like(encoder, np.nan)
    force = np.zeros_like(encoder)
    if command is not None and recorded:
        force = grid.columns(command, 'effort', axes) * effort_unit
    record = Record(
        name=session.path,
        axes=axes,
        period=period,
        time=grid.time,
        reference=grid.positions(reference, axes),
        reference_velocity=grid.optional(reference, 'velocity', axes),
        velocity_command=(
            nothing if command is None else grid.optional(command, 'velocity', axes)
        ),
        force=force,
        effort_recorded=recorded,
        encoder=encoder,
        temperature=screw_temperatures(session, axes, grid.stamp_time),
        tracker_time=None,
        tracker=None,
        held_out_session=held_out,
        warnings=(*session.warnings, *grid.warnings),
        clock=grid.clock,
        gaps=grid.gaps,
        setpoint_velocity=_declared(session, axes, grid),
    )
    check_units(record)
    record = replace(record, waves=_waves(record, resolution, twin))
    record = _moved(replace(record, noise=_noise(record, resolution, grid.offset)))
    check_excitation(record)
    if recorded:
        check_forces(record)
    return with_tracker_noise(with_tracker(record, session))


def _moved(record: Record) -> Record:
    """The record with which of its axes move."""
    travel = np.ptp(record.encoder, axis=0).tolist()
    moving = tuple(path > least_travel(record, i) for i, path in enumerate(travel))
    return replace(record, moving=moving)


def has_effort(session: Session, axes: tuple[str, ...]) -> bool:
    """Whether the commands of a session hold an effort of each axis."""
    if not session.has(topics.COMMAND):
        return False
    values = session.series[topics.COMMAND].values
    return all(np.any(np.isfinite(values.get(f'effort.{axis}', np.nan))) for axis in axes)


def _commands(session: Session, axes: tuple[str, ...], effort: bool) -> Series | None:
    """Commands of a session; without effort what else they hold, None where that is nothing."""
    if effort:
        return finite(session.require(topics.COMMAND, 'holds the forces'), session.path)
    if not session.has(topics.COMMAND):
        return None
    series = session.series[topics.COMMAND]
    names = [f'velocity.{axis}' for axis in axes]
    if not all(np.isfinite(series.values.get(name, np.nan)).all() for name in names):
        return None
    return finite(replace(series, values={n: series.values[n] for n in names}), session.path)


def _waves(record: Record, resolution: Array, twin: TwinFile) -> Parameters:
    """What each encoder reads over its own position; the steps of a coarse one are none."""
    whole, tells = record.whole(record.time), record.effort_recorded and twin.kind == 'servo'
    found: Parameters = {}
    for i, (axis, step) in enumerate(zip(record.axes, resolution.tolist(), strict=True)):
        position, period = record.encoder[:, i], record.period
        quantum = max(step, encoder_step(position))
        own = reading_wave(position, period, whole, quantum)
        if not own and tells:
            driven = record.force[:, i] / nominal_mass(twin.axes[axis])[0]
            own = driven_wave(position, driven, period, whole, quantum)
        found |= {f'{MISREADS}.{axis}': own} if own else {}
    return found


def _noise(record: Record, resolution: Array, offset: Array) -> Noise:
    whole = record.whole(record.time)
    own, sampling = [], []
    for i, step in enumerate(resolution.tolist()):
        q, force = record.motion(i), record.force[:, i]
        own.append(axis_noise(q, record.period, step, whole, white_part(force, whole)))
        sampling.append(sampling_jitter(q, offset, record.period, step, whole))
    return Noise(tuple(own), sampling=tuple(sampling))


def with_tracker_noise(record: Record) -> Record:
    """The record with the measured noise of its tracker beside that of its axes."""
    if record.tracker_time is None or record.tracker is None or record.noise is None:
        return record
    time, step = record.tracker_time, record.period
    moves = record.encoder_at(time + step) - record.encoder_at(time - step)
    own = math.sqrt(float(np.mean([n.position**2 for n in record.noise.axes])))
    noise = tracker_noise(
        record.tracker - record.encoder_at(time), np.linalg.norm(moves, axis=1) / (2 * step), own
    )
    return replace(record, noise=replace(record.noise, tracker=noise))


def _declared(session: Session, axes: tuple[str, ...], grid: Grid) -> Mask | None:
    """Ticks (n,) for which a set-point with a velocity came; None where there is none."""
    if not session.has(topics.SETPOINT):
        return None
    series = session.series[topics.SETPOINT]
    if any(f'velocity.{axis}' not in series.values for axis in axes):
        return None
    carried = np.isfinite(series.columns('velocity', axes)).all(axis=1)
    stamps = to_seconds(series.stamps[carried], session.start_ns)
    mask = np.zeros(len(grid.time), dtype=bool)
    at = np.searchsorted(grid.stamp_time, stamps - 0.5 * grid.period)
    mask[at[at < len(mask)]] = True
    return mask


def screw_temperatures(session: Session, axes: tuple[str, ...], time: Array) -> Array | None:
    """Screw temperature of each axis (n, a) [degC] at some times [s]; None where not recorded."""
    sensors = session.temperatures()
    columns = []
    for axis in axes:
        series = sensors.get(f'screw_{axis}')
        if series is None or len(series) == 0:
            return None
        finite(series, session.path)
        seconds = to_seconds(series.stamps, session.start_ns)
        columns.append(np.interp(time, seconds, series.values['temperature']))
    return np.column_stack(columns)


def with_tracker(record: Record, session: Session) -> Record:
    """The record with the tracker points of its time; as it is where there are none."""
    if not session.has(topics.TRACKER_POINT):
        return record
    series = finite(session.series[topics.TRACKER_POINT], session.path)
    stamps = to_seconds(series.stamps, session.start_ns)
    seconds = stamps if record.clock is None else record.clock.to_machine(stamps)
    points = session.table_points()
    # Two ticks from the ends: the encoder is interpolated with its neighbours.
    margin = 5 * record.period
    use = (seconds >= record.time[0] + margin) & (seconds <= record.time[-1] - margin)
    use &= record.whole(seconds)
    if np.count_nonzero(use) < 50:
        raise StageError(
            f'{session.path}: only {np.count_nonzero(use)} of {len(seconds)} points of '
            f'{topics.TRACKER_POINT} lie in the time of the stage topics: the stamps do not '
            'overlap, check the clock of the tracker bridge'
        )
    columns = [('x', 'y').index(axis) for axis in record.axes]
    tracker = points[use][:, columns]
    found = replace(record, tracker_time=seconds[use], tracker=tracker, tracker_stamp=stamps[use])
    check_tracker_moves(found)
    return found
