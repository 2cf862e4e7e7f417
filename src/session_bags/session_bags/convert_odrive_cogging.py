"""``ros2 run session_bags convert_odrive_cogging``: a motor turned slowly, as session bags."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from session_bags.measured import (
    EPOCH,
    MINUTE,
    converter,
    derivative,
    drive_session,
    fit_force,
    load,
    second_derivative,
)
from stage_core.arrays import Array
from stage_core.session import Session
from stage_core.twin_file import ForceAxis, TwinFile

RECORDS = tuple(f'slow2_{kind}_{number}' for kind in ('nocomp', 'comp') for number in range(3))
#: Arrays of a record, each (n,): time [s], position [counts], current [A].
NEEDED = ('t', 'position', 'current')
COUNTS = 8192.0  # of the encoder in a turn
TURN = 10.0  # s
PERIOD = 0.002  # s, of the even ticks that the samples are interpolated to
#: A record that begins with a fast return of the turn before, and the end of it [s].
_RETURN, _RETURNED = 'slow2_nocomp_1', 0.3


def even(record: dict[str, Array]) -> tuple[Array, Array, Array]:
    """Even ticks (n,) [s], angle [rad] and current [A] (n, 1) of samples 1.5 to 4.7 ms apart."""
    ticks = np.arange(record['t'][0], record['t'][-1], PERIOD)
    angle = 2.0 * math.pi / COUNTS * np.interp(ticks, record['t'], record['position'])
    current = np.interp(ticks, record['t'], record['current'])
    return ticks, angle[:, None], current[:, None]


def fit_twin(record: dict[str, Array]) -> TwinFile:
    """Nominal twin of kind ``measured_force``, from the fast return of a turn.

    No inertia and no torque constant is published, so the mass is in A·s²/rad and viscous in
    A·s/rad.
    """
    ticks, angle, current = even(record)
    own = ticks < _RETURNED
    speed, acceleration = derivative(angle, ticks, 11), second_derivative(angle, ticks, 11)
    mass, viscous = fit_force(current[own, 0], speed[own, 0], acceleration[own, 0])
    axis = ForceAxis(
        mass=mass,
        viscous=viscous,
        encoder_resolution=2.0 * math.pi / COUNTS,
        lead=2.0 * math.pi,
    )
    return TwinFile(kind='measured_force', axes={'x': axis}, control_period=PERIOD)


def sessions(folder: Path) -> dict[str, Session]:
    """One session per record, named as its file.

    The axis turns, so that its metres are radians, and its effort is the current [A]. The
    reference is the constant speed that was asked for.
    """
    records = {
        name: load(
            folder / 'odrive_cogging' / f'{name}.npz', NEEDED, {'t': ('position', 'current')}
        )
        for name in RECORDS
    }
    twin = fit_twin(records[_RETURN]).to_dict()
    found = {}
    for number, (name, record) in enumerate(records.items()):
        ticks, angle, current = even(record)
        reference = 2.0 * math.pi / TURN * ticks[:, None]
        session = drive_session(name, ticks, EPOCH + number * MINUTE, reference, angle, current)
        found[name] = replace(session, twin=twin)
    return found


main = converter('A brushless motor turned slowly, as session bags.', sessions)
