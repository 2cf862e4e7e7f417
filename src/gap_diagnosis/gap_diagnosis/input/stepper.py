"""Sessions of an open-loop stage: rests of the counted motion beside the tracker.

A stepper has no servo link, and its count of motor steps comes tens of times a second over a
wire. While it moves, the time of a count is known to milliseconds only, which at 100 mm/s are
hundreds of micrometres. At rest time does not matter: the mean of the tracker points of a rest is
one row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from gap_diagnosis.input.checks import (
    MINIMUM_TRAVEL,
    check_excitation,
    check_tracker_moves,
    check_units,
    finite,
)
from gap_diagnosis.input.data import (
    Record,
    known_axes,
    screw_temperatures,
    with_tracker,
    with_tracker_noise,
)
from gap_diagnosis.input.grid import SAME
from gap_diagnosis.input.noise import CLEARLY_NOISIER, GAUSS, Noise, axis_noise
from stage_core import topics
from stage_core.arrays import Array
from stage_core.clocks import to_seconds
from stage_core.errors import StageError
from stage_core.quantities import AXES
from stage_core.rests import find_rests
from stage_core.session import Series, Session
from stage_core.twin_file import StepperAxis, TwinFile
from stage_twin.effects import EFFECTS

LARGEST_TRAVEL = 20.0  # m; a larger number is a count of motor steps
STILL = 2.5e-7  # m between two counts at rest
LEAST_REST = 0.2  # s
EDGE = 0.06  # s at both ends of a rest: age of a count, and what rings after a move
LEAST_POINTS = 5  # of a rest
LEAST_RESTS = 12
LEAST_REPEATS = 6  # rests beyond the first of their place, to know a scatter from
UNSEEN_BY_ENCODER = tuple(n for n, effect in EFFECTS.items() if not effect.seen_by_encoder)
#: Of a microstep, within which a number is a whole count of them.
WHOLE = 1e-3
ENCODED = (
    'no tracker: the encoder measures in its place; what lies behind it, and between the axes, '
    'does not show'
)
HINT = 'record one with at least 18 rests of 0.5 s (`ros2 run stage_bringup session`)'


@dataclass(frozen=True)
class _Rests:
    """Rests: middle (m,) [s], mean tracker point (m, a) [m], number of points, counted place.

    `side` (m, a) is the sign of each axis' last motion before the rest, 0 before its first;
    `noise` is that of a point [m].
    """

    time: Array
    point: Array
    count: Array
    where: Array
    side: Array
    noise: float


def load_stepper_record(session: Session, twin: TwinFile, held_out: bool = False) -> Record:
    """Arrays of a session of a stepper stage: its tracker rows are rests.

    A session without enough of them is judged in motion where every point has the stamp of a
    count: one controller read both. Without a tracker an encoder measures in its place.

    Raises
    ------
    StageError
        If a topic is missing or wrong, the twin belongs to another machine, or there are too
        few rests.
    """
    axes = known_axes(session, twin)
    _refuse_forces(session)
    encoded = by_encoder(session)
    if encoded:
        session = _measured_by_encoder(session, axes, twin)
    if not session.has(topics.TRACKER_POINT):
        raise StageError(
            f'{session.path} holds no message of {topics.TRACKER_POINT}: a stepper stage is '
            'diagnosed against the tracker, or against an encoder in '
            f'{topics.JOINT_STATES} beside the command in {topics.REFERENCE}'
        )
    points = finite(session.series[topics.TRACKER_POINT], session.path)
    series, counted, motion = _counted(session, axes, twin)
    rests = _rests(session, twin, counted, motion, [AXES.index(axis) for axis in axes])
    time = np.arange(counted[0], counted[-1], twin.control_period)
    encoder = np.column_stack([np.interp(time, counted, column) for column in motion.T])
    nothing = np.full_like(encoder, np.nan)
    record = Record(
        name=session.path,
        axes=axes,
        period=twin.control_period,
        time=time,
        reference=encoder,
        reference_velocity=nothing,
        velocity_command=nothing,
        force=nothing,
        encoder=encoder,
        temperature=screw_temperatures(session, axes, time),
        tracker_time=rests.time,
        tracker=rests.point,
        held_out_session=held_out,
        moving=tuple(bool(m) for m in np.ptp(encoder, axis=0) > MINIMUM_TRAVEL),
        warnings=session.warnings,
    )
    if len(rests.time) >= LEAST_RESTS:
        record = _at_rests(record, rests, np.array([_step(twin, a) for a in axes]))
    elif np.isin(points.stamps, series.stamps).mean() > SAME:
        record = _in_motion(record, session, twin)
    else:
        raise StageError(
            f'{session.path} holds {len(rests.time)} rests of the stage that the tracker sees, a '
            f'diagnosis of a stepper stage needs {LEAST_RESTS}: {HINT}'
        )
    if encoded:
        record = replace(record, warnings=(*record.warnings, ENCODED))
    for check in (check_units, check_excitation, check_tracker_moves):
        check(record)
    return record


def by_encoder(session: Session) -> bool:
    """Whether the encoder has to measure: there is no tracker, and a command beside it."""
    beside = session.has(topics.JOINT_STATES) and session.has(topics.REFERENCE)
    return beside and not session.has(topics.TRACKER_POINT)


def _measured_by_encoder(session: Session, axes: tuple[str, ...], twin: TwinFile) -> Session:
    """The session with the encoder as what measures, and the command as what was counted.

    Raises
    ------
    StageError
        If the joint states are the counted steps themselves.
    """
    states = session.series[topics.JOINT_STATES]
    command = session.series[topics.REFERENCE]
    positions = _metres(states, axes, twin)
    for axis, position in zip(axes, positions.T, strict=True):
        steps = np.rint(position / _step(twin, axis))
        apart = np.abs(position - steps * _step(twin, axis)).max()
        own = np.interp(states.stamps, command.stamps, command.values[f'position.{axis}'])
        if apart < WHOLE * _step(twin, axis) and np.median(np.abs(position - own)) < STILL:
            raise StageError(
                f'{session.path} holds no message of {topics.TRACKER_POINT}, and '
                f'{topics.JOINT_STATES} are the counted steps: record a tracker or an encoder'
            )
    still = np.zeros(len(states.stamps))
    columns = dict(zip(axes, positions.T, strict=True))
    points = {name: columns.get(name, still) for name in ('x', 'y', 'z')}
    series = {k: s for k, s in session.series.items() if k != topics.JOINT_STATES}
    series[topics.TRACKER_POINT] = Series(topics.TRACKER_POINT, states.stamps, points)
    return replace(session, series=series, alignment=None)


def _counted(
    session: Session, axes: tuple[str, ...], twin: TwinFile
) -> tuple[Series, Array, Array]:
    """What was counted, its times (n,) [s] each once, and the motion then (n, axes) [m]."""
    topic = topics.JOINT_STATES if session.has(topics.JOINT_STATES) else topics.REFERENCE
    series = finite(session.require(topic, 'holds the counted motion'), session.path)
    times, first = np.unique(to_seconds(series.stamps, session.start_ns), return_index=True)
    if len(times) < 3:
        raise StageError(f'{session.path} is too short: it holds {len(times)} counts; {HINT}')
    return series, times, _metres(series, axes, twin)[first]


def _at_rests(record: Record, rests: _Rests, step: Array) -> Record:
    return replace(
        record,
        warnings=(
            *record.warnings,
            f'{len(rests.time)} rests are judged, each by the mean of its tracker points; motion '
            'between them is not, nor are the servo link and the tracker clock',
        ),
        row_noise=rests.noise / math.sqrt(float(np.median(rests.count))),
        rest_scatter=_repeats(rests, step),
    )


def _in_motion(record: Record, session: Session, twin: TwinFile) -> Record:
    whole = np.ones(len(record.time), dtype=bool)
    axes = tuple(
        axis_noise(column, record.period, _step(twin, axis), whole)
        for axis, column in zip(record.axes, record.encoder.T, strict=True)
    )
    return with_tracker_noise(
        with_tracker(replace(record, noise=Noise(axes, sampling=(None,) * len(axes))), session)
    )


def _step(twin: TwinFile, axis: str) -> float:
    own = twin.axes[axis]
    return own.microstep if isinstance(own, StepperAxis) else STILL


def _repeats(rests: _Rests, step: Array) -> float | None:
    """Pooled standard deviation [m] of rests at the same place reached from the same side.

    Repeatability as ISO 230-2 has it, per coordinate; None where fewer than six rests repeat.
    """
    known = np.all((rests.side != 0.0) | (np.ptp(rests.where, axis=0) == 0.0), axis=1)
    place = np.hstack([np.rint(rests.where / np.maximum(4.0 * step, STILL)), rests.side])[known]
    if not len(place):
        return None
    _, group = np.unique(place, axis=0, return_inverse=True)
    group = group.ravel()
    size = np.bincount(group)
    freedom = int(np.sum(size - 1))
    if freedom < LEAST_REPEATS:
        return None
    own = rests.point[known]
    sums = np.zeros((len(size), own.shape[1]))
    np.add.at(sums, group, own)
    rest = own - (sums / size[:, None])[group]
    return float(np.sqrt(np.sum(rest**2) / (freedom * own.shape[1])))


def sides(motion: Array) -> Array:
    """Sign (n, a) of the last motion of each axis up to each count, 0 before its first.

    An approach from one side overshoots a place that lies on the other (ISO 230-2): where the
    rest before was says nothing.
    """
    moves = np.diff(motion, axis=0, prepend=motion[:1])
    sign = np.where(np.abs(moves) < STILL, 0.0, np.sign(moves))
    last = np.maximum.accumulate(np.where(sign != 0.0, np.arange(len(sign))[:, None], 0), axis=0)
    return np.asarray(np.take_along_axis(sign, last, axis=0))


def _refuse_forces(session: Session) -> None:
    if not session.has(topics.COMMAND):
        return
    values = session.series[topics.COMMAND].values
    if any(np.any(np.nan_to_num(v) != 0.0) for k, v in values.items() if k.startswith('effort')):
        raise StageError(
            f'{session.path} holds forces in {topics.COMMAND}, a twin of kind stepper has none: '
            'give the twin file of this machine'
        )


def _metres(series: Series, axes: tuple[str, ...], twin: TwinFile) -> Array:
    """Counted motion (n, a) [m]; a topic whose numbers are too large for metres counts steps."""
    values = series.columns('position', axes)
    if float(np.max(np.abs(values), initial=0.0)) <= LARGEST_TRAVEL:
        return values
    steps = [axis.microstep for a in axes if isinstance(axis := twin.axes[a], StepperAxis)]
    return np.asarray(values * np.array(steps))


def _rests(
    session: Session, twin: TwinFile, counted: Array, motion: Array, columns: list[int]
) -> _Rests:
    """Rests of all axes together, each with the mean of the points at which the table stood.

    Raises
    ------
    StageError
        If the stamps of points and counts do not overlap.
    """
    series = session.series[topics.TRACKER_POINT]
    seconds = to_seconds(series.stamps, session.start_ns)
    points = session.table_points()[:, columns]
    if seconds[-1] < counted[0] or seconds[0] > counted[-1]:
        raise StageError(
            f'{session.path}: the stamps of {topics.TRACKER_POINT} and of the stage topics do not '
            'overlap: check the clock of the tracker bridge'
        )
    seen = []
    for start, stop in find_rests(counted, motion, LEAST_REST, STILL):
        low, high = np.searchsorted(seconds, (counted[start] + EDGE, counted[stop - 1] - EDGE))
        if high - low >= LEAST_POINTS:
            seen.append((start, stop, points[low:high]))
    noise = _point_noise([own for _, _, own in seen], twin)
    approached = sides(motion)
    time, mean, count, where, side = [], [], [], [], []
    for start, stop, own in seen:
        # A command at rest is no table at rest: what is far from the rest's end still moves.
        end = np.median(own[len(own) // 2 :], axis=0)
        use = np.all(np.abs(own - end) < 6.0 * noise, axis=1)
        if np.count_nonzero(use) < max(LEAST_POINTS, 0.4 * len(own)):
            continue
        time.append(0.5 * (counted[start] + counted[stop - 1]))
        mean.append(own[use].mean(axis=0))
        count.append(float(np.count_nonzero(use)))
        where.append(motion[stop - 1])
        side.append(approached[start])
    shape = (len(time), motion.shape[1])
    return _Rests(
        np.array(time),
        np.array(mean).reshape(shape),
        np.array(count),
        np.array(where).reshape(shape),
        np.array(side).reshape(shape),
        noise,
    )


def _point_noise(rests: list[Array], twin: TwinFile) -> float:
    """Noise [m] of a tracker point: the twin's, unless the points of rests are clearly noisier.

    Neighbours differ by √2 of it, however the table settles.
    """
    stated = twin.tracker.noise if twin.tracker is not None else 1.0e-6
    steps = [np.median(np.abs(np.diff(own, axis=0)), axis=0) for own in rests]
    if not steps:
        return stated
    measured = float(np.max(np.median(steps, axis=0))) * GAUSS / math.sqrt(2.0)
    return measured if measured > CLEARLY_NOISIER * stated else stated
