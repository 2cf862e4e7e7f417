"""``ros2 run session_bags convert_ess_tank``: the stepper-driven rotary axis as a session bag."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from session_bags.measured import EPOCH, convert, derivative, load
from stage_core import topics
from stage_core.clocks import to_stamps
from stage_core.errors import command_line
from stage_core.session import Series, Session


def sessions(folder: Path) -> dict[str, Session]:
    """The long stroke: motor count as commanded position, encoder as the measured table.

    The axis turns, so that its metres are radians: position x is the motor's angle [rad], the
    tracker's x the encoder's change of angle since the beginning [rad]. Both keep their own time
    axis.
    """
    record = load(folder / 'ess_tank' / 'stroke.npz')
    motor_time, motor = record['motor_t'], record['motor']
    velocity = derivative(motor[:, None], motor_time)[:, 0]
    stamps = to_stamps(motor_time, EPOCH)
    columns = {'position.x': motor, 'velocity.x': velocity}
    encoder = record['encoder'] - record['encoder'][0] + motor[0]
    zeros = np.zeros(len(encoder))
    points = {'x': encoder, 'y': zeros, 'z': zeros}
    found = {
        topics.REFERENCE: Series(topics.REFERENCE, stamps, columns),
        topics.JOINT_STATES: Series(topics.JOINT_STATES, stamps, dict(columns)),
        topics.COMMAND: Series(topics.COMMAND, stamps, {'velocity.x': velocity}),
        topics.TRACKER_POINT: Series(
            topics.TRACKER_POINT, to_stamps(record['encoder_t'], EPOCH), points
        ),
    }
    return {'ess_tank_stroke': Session('ess_tank_stroke', found)}


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Convert the stroke."""
    return convert('A stepper-driven rotary axis as a session bag.', sessions, arguments)


if __name__ == '__main__':
    sys.exit(main())
