"""``ros2 run session_bags convert_ess_tank``: the stepper-driven rotary axis as session bags."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from session_bags.measured import DAY, EPOCH, converter, derivative, load
from stage_core import topics
from stage_core.arrays import Array
from stage_core.clocks import to_stamps
from stage_core.session import Series, Session, by_topic
from stage_core.twin_file import StepperAxis, TrackerSpec, TwinFile

#: Arrays of the two files, each (n,): times [s], angles [rad], sign of the approach.
STROKE = ('motor_t', 'motor', 'encoder_t', 'encoder')
STOPS = ('motor', 'encoder', 'approach')
#: Least step of the recorded encoder [rad]; the motor's count has finer ones.
STEP = 2.33e-6
#: Stops are read once. A bag shows each as a move to its place from the side of its approach, from
#: `ASIDE` [rad] away, and a rest [s] in which the reading stands, at `RATE` [Hz].
ASIDE, MOVE, REST, RATE = 0.01, 0.5, 1.0, 20.0


def nominal(period: float) -> TwinFile:
    """A stepper axis whose metres are radians and whose encoder stands for the tracker."""
    axes = {'x': StepperAxis(microstep=1.0e-7, max_speed=1.0, acceleration=10.0)}
    tracker = TrackerSpec(rate=1.0 / period, noise=STEP / math.sqrt(12.0))
    return TwinFile(kind='stepper', axes=dict(axes), control_period=period, tracker=tracker)


def session_of(
    name: str, start: int, motor_time: Array, motor: Array, time: Array, encoder: Array
) -> Session:
    """Motor count as the commanded position, encoder as the measured table.

    The axis turns, so that its metres are radians: position x is the motor's angle [rad], the
    tracker's x the encoder's, whose zero is that of the motor on average. Both keep their own
    time axis.
    """
    stamps = to_stamps(motor_time, start)
    motor = motor[:, None]
    velocity = derivative(motor, motor_time)
    zero = np.mean(encoder - np.interp(time, motor_time, motor[:, 0]))
    found = by_topic(
        Series.per_axis(topics.REFERENCE, stamps, position=motor, velocity=velocity),
        Series.per_axis(topics.JOINT_STATES, stamps, position=motor, velocity=velocity),
        Series.per_axis(topics.COMMAND, stamps, velocity=velocity),
        Series.points(topics.TRACKER_POINT, to_stamps(time, start), (encoder - zero)[:, None]),
    )
    return Session(name, found, nominal(float(np.median(np.diff(motor_time)))).to_dict())


def stops(record: Mapping[str, Array]) -> Session:
    """The stops as moves and rests, those left out whose encoder lost its count.

    Such a stop is further from the motor than a turn.
    """
    apart = record['encoder'] - record['motor']
    kept = np.abs(apart - np.median(apart)) < 2.0 * np.pi
    place, encoder = record['motor'][kept], record['encoder'][kept]
    aside = place - np.sign(record['approach'][kept]) * ASIDE
    length = 2.0 * MOVE + REST
    knots = np.arange(len(place))[:, None] * length + [0.0, MOVE, 2.0 * MOVE, length - 1e-9]
    before = np.concatenate([place[:1], place[:-1]])
    path = np.column_stack([before, aside, place, place])
    time = np.arange(0.0, len(place) * length, 1.0 / RATE)
    motor = np.interp(time, knots.ravel(), path.ravel())
    number = np.minimum((time / length).astype(int), len(place) - 1)
    still = time - number * length > 2.0 * MOVE - 1e-6
    name = 'ess_tank_stops'
    session = session_of(name, EPOCH + DAY, time, motor, time[still], encoder[number[still]])
    lost = int(np.count_nonzero(~kept))
    said = f'{lost} stops whose encoder lost its count are left out'
    return replace(session, warnings=(said,) if lost else ())


def sessions(folder: Path) -> dict[str, Session]:
    """The long stroke, and the stops of the repeatability test."""
    record = load(
        folder / 'ess_tank' / 'stroke.npz',
        STROKE,
        {'motor_t': ('motor',), 'encoder_t': ('encoder',)},
    )
    name = 'ess_tank_stroke'
    parts = (record[key] for key in STROKE)
    stroke = session_of(name, EPOCH, *parts)
    return {
        name: stroke,
        'ess_tank_stops': stops(load(folder / 'ess_tank' / 'repeatability.npz', STOPS)),
    }


main = converter('A stepper-driven rotary axis as session bags.', sessions)
