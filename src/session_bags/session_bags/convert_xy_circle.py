"""``ros2 run session_bags convert_xy_circle``: the recorded XY stage as session bags."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from session_bags.measured import (
    DAY,
    EPOCH,
    MINUTE,
    converter,
    derivative,
    drive_session,
    fit_force,
    load,
    second_derivative,
)
from stage_core import topics
from stage_core.arrays import Array
from stage_core.clocks import to_stamps
from stage_core.errors import StageError
from stage_core.session import Series, Session
from stage_core.twin_file import ForceAxis, TwinFile

#: Arrays of a record: time (n,) [s], places (n, 2) [m], command (n, 2) [V], force (n, 3).
NEEDED = ('t', 'reference', 'encoder', 'command', 'contact_force')
#: The record whose motion the nominal twin is fitted to.
_FIT = 'day1_a'


def fit_twin(seconds: Array, encoder: Array, command: Array) -> TwinFile:
    """Nominal twin of kind ``measured_force``: the command fitted to the motion, per axis.

    Commands are in volt: no force constant is published, so mass is in V·s²/m and viscous in
    V·s/m. The lap accelerates by 0.02 m/s² only, so that the mass is uncertain to a factor of two.
    """
    velocity, acceleration = derivative(encoder, seconds), second_derivative(encoder, seconds)
    axes = {}
    for number, axis in enumerate('xy'):
        mass, viscous = fit_force(command[:, number], velocity[:, number], acceleration[:, number])
        axes[axis] = ForceAxis(mass=mass, viscous=viscous)
    return TwinFile(kind='measured_force', axes=dict(axes), control_period=0.001)


def sessions(folder: Path) -> dict[str, Session]:
    """One session per record of ``xy_circle``, named as its file."""
    files = sorted((folder / 'xy_circle').glob('*.npz'))
    if not files:
        raise StageError(f'{folder / "xy_circle"} holds no record: name the folder of the data')
    records = {file.stem: load(file, NEEDED, {'t': NEEDED[1:]}) for file in files}
    fit = records.get(_FIT) or records[files[0].stem]
    twin = fit_twin(fit['t'], fit['encoder'], fit['command']).to_dict()
    found = {}
    for number, (name, record) in enumerate(records.items()):
        seconds = record['t']
        start = EPOCH + number * 10 * MINUTE + (DAY if name.startswith('day2') else 0)
        session = drive_session(
            name, seconds, start, record['reference'], record['encoder'], record['command']
        )
        stamps = to_stamps(seconds, start)
        session.series[topics.CONTACT_FORCE] = Series.per_axis(
            topics.CONTACT_FORCE, stamps, force=record['contact_force']
        )
        found[name] = replace(session, twin=twin)
    return found


main = converter('The recorded XY stage on its circle, as session bags.', sessions)
