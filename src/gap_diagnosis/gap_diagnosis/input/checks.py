"""Checks that a session has to pass before it is diagnosed: one line that names the remedy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from stage_core import topics
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.session import Series
from stage_core.tracker_frame import OTHER_UNIT, OUTER, SINGLE, extent, other_unit
from stage_core.twin_file import TwinFile

if TYPE_CHECKING:
    from gap_diagnosis.input.data import Record

MINIMUM_DURATION = 8.0  # s of all records; below it no held-out window has a reversal of its own
SHORTEST = 1.0  # s of one record, of which the first half is not judged
MINIMUM_TRAVEL = 2.0e-4  # m; a stepper, or a reference, that moves less rests
#: Steps of an encoder, its noise counted, within which an axis rests: resting ones of 13 sessions
#: read 4 at most, one that the other axis pushed 396.
RESTS_WITHIN = 40.0
STANDSTILL = 2.0  # s in which a tracker must show what the encoder does
LEAST_MOVE = 1.0e-3  # m of the encoder in the middle of that time
EXCITATION_HINT = 'record one that has it with `ros2 run contour_ctrl excite`'


def finite(series: Series, path: str) -> Series:
    """The series, refused where it holds NaNs or its stamps run backwards."""
    for name, values in series.values.items():
        bad = int(np.count_nonzero(~np.isfinite(values)))
        if bad:
            raise StageError(
                f'{path}: {series.topic} holds {bad} values of {name} that are not numbers: '
                'record the session again or cut them out'
            )
    if len(series) > 1 and np.any(np.diff(series.stamps) < 0):
        raise StageError(f'{path}: the stamps of {series.topic} run backwards: sort the bag')
    return series


def least_travel(record: Record, i: int) -> float:
    """Travel of an axis [m] up to which it rests."""
    return MINIMUM_TRAVEL if record.noise is None else RESTS_WITHIN * record.noise.axes[i].step


def check_duration(records: Sequence[Record]) -> None:
    """Refuse records that are too short: one of them, or all of them together."""
    shortest = min(records, key=lambda r: r.duration)
    duration = sum(r.duration for r in records)
    if shortest.duration < SHORTEST:
        raise StageError(
            f'{shortest.name} is too short: {shortest.duration:.1f} s, a record needs at least '
            f'{SHORTEST:.0f} s; leave it out'
        )
    if duration < MINIMUM_DURATION:
        raise StageError(
            f'{shortest.name} is too short: {duration:.1f} s, a diagnosis needs at least '
            f'{MINIMUM_DURATION:.0f} s; {EXCITATION_HINT}, or give several records of the machine'
        )


def check_tracker_moves(record: Record) -> None:
    """Refuse a session whose tracker stands while the encoder moves, or has another unit."""
    assert record.tracker is not None
    travel = np.ptp(record.encoder, axis=0)
    seen = np.ptp(record.tracker, axis=0)
    # Of a frame that is turned, an axis alone may move the other coordinate.
    stands = seen < 0.01 * travel if all(record.moving) else seen.max() < 0.01 * travel
    for i, axis in enumerate(record.axes):
        if record.moving[i] and stands[i]:
            raise StageError(
                f'{record.name}: the tracker is frozen: {topics.TRACKER_POINT} does not move in '
                f'{axis} while the encoder does; check the reflector and record again'
            )
    if wrong := other_unit(record.tracker, record.encoder, 'the encoder'):
        raise StageError(f'{record.name}: {topics.TRACKER_POINT} {wrong}')
    if record.row_noise is None:
        _check_tracker_goes_on(record)


def _check_tracker_goes_on(record: Record) -> None:
    """Refuse a session whose tracker stands for a while in which the encoder moves."""
    assert record.tracker is not None and record.tracker_time is not None
    time = record.tracker_time
    inner = 0.25 * STANDSTILL
    for start in np.arange(record.time[0], record.time[-1] - STANDSTILL, 0.5 * STANDSTILL):
        seen = record.tracker[slice(*np.searchsorted(time, (start, start + STANDSTILL)))]
        # The points may be late: the encoder's ends of the window are not asked for.
        ends = np.searchsorted(record.time, (start + inner, start + STANDSTILL - inner))
        moved = float(np.ptp(record.encoder[slice(*ends)], axis=0).max(initial=0.0))
        if len(seen) < 10 or moved < LEAST_MOVE:
            continue
        if float(np.ptp(seen, axis=0).max()) < 0.01 * moved:
            raise StageError(
                f'{record.name}: the tracker is frozen {start:.1f} s after the start: '
                f'{topics.TRACKER_POINT} stands there for {STANDSTILL:.0f} s while the encoder '
                f'moves by {1e3 * moved:.1f} mm; cut that part out or record again'
            )


def check_forces(record: Record) -> None:
    """Refuse a session whose force is not recorded though the axis speeds up and slows down."""
    for i, axis in enumerate(record.axes):
        if record.moving[i] and float(np.ptp(record.force[:, i])) == 0.0:
            raise StageError(
                f'{record.name}: the effort of axis {axis} in {topics.COMMAND} is '
                f'{record.force[0, i]:g} all the time while the axis moves: the force is not '
                'recorded; record it, or give a twin of kind stepper for a stage without one'
            )


def check_excitation(record: Record) -> None:
    """Refuse a session without motion."""
    if not any(record.moving):
        wanted = np.ptp(record.reference, axis=0)
        cause = (
            'the encoder is frozen while the reference moves'
            if np.any(wanted > [least_travel(record, i) for i in range(len(record.axes))])
            else 'no axis moves: motion is missing'
        )
        raise StageError(f'{record.name} has no excitation: {cause}; {EXCITATION_HINT}')


def check_units(record: Record) -> None:
    """Refuse a session whose encoder is in another unit than its reference, or errs once.

    An axis that was not asked to move may be pushed by another one.
    """
    for i, axis in enumerate(record.axes):
        encoder, reference = record.encoder[:, [i]], record.reference[:, [i]]
        wanted, least = float(np.ptp(reference)), OTHER_UNIT * MINIMUM_TRAVEL
        if float(np.ptp(encoder)) <= max(OTHER_UNIT * wanted, least):
            continue
        wrong = other_unit(encoder, reference, 'its reference')
        if wanted <= MINIMUM_TRAVEL:
            wrong = SINGLE if extent(encoder, OUTER) < least else ''
        if wrong:
            raise StageError(f'{record.name}: the encoder of axis {axis} {wrong}')


def reverses(record: Record, i: int) -> bool:
    """Whether an axis goes back at least once by a twentieth of its travel."""
    return _turns(record, i) > 0


def turns(records: list[Record]) -> dict[str, int]:
    """Number of times that each axis goes back by a twentieth of its travel, in all records."""
    axes = records[0].axes
    return {axis: sum(_turns(r, i) for r in records) for i, axis in enumerate(axes)}


def _turns(record: Record, i: int) -> int:
    position = record.encoder[:, i]
    return reversals(position, 0.05 * float(np.ptp(position)))


def reversals(position: Array, threshold: float) -> int:
    """Number of changes of direction of a position (n,) that go back by `threshold` [m]."""
    count, direction, extreme = 0, 0, float(position[0])
    for value in position[:: max(1, len(position) // 20000)]:
        if direction >= 0 and value > extreme or direction <= 0 and value < extreme:
            extreme = float(value)
            if direction == 0 and abs(extreme - position[0]) > threshold:
                direction = 1 if extreme > position[0] else -1
        elif abs(value - extreme) > threshold:
            count += int(direction != 0)
            direction = 1 if value > extreme else -1
            extreme = float(value)
    return count


def check_controller(record: Record, twin: TwinFile) -> None:
    """Refuse a servo twin without velocity commands, or whose limit the forces exceed."""
    for i, name in enumerate(record.axes):
        axis = twin.servo(name)
        if not np.isfinite(record.velocity_command[:, i]).all():
            raise StageError(
                f'{record.name}: {topics.COMMAND} holds no velocity of axis {name}, which a twin '
                'of kind servo needs: give a twin of kind measured_force'
            )
        if not record.moving[i]:
            continue
        force = record.force[1:, i]
        worst = int(np.argmax(np.abs(force)))
        beyond = float(np.mean(np.abs(force) > 1.01 * axis.force_limit))
        if beyond > 0.01:
            raise StageError(
                f'{record.name}: {100 * beyond:.0f} % of the recorded forces of axis {name} '
                f"exceed the twin's force_limit of {axis.force_limit:g} N: the twin belongs to "
                'another machine (limit or units)'
            )
        if abs(force[worst]) > OTHER_UNIT * axis.force_limit:
            raise StageError(
                f'{record.name}: the effort of axis {name} is {force[worst]:.3g} N at '
                f'{record.time[worst + 1]:.3f} s, far beyond the force_limit of '
                f'{axis.force_limit:g} N: cut that part out, or record it again'
            )
