"""``ros2 run session_bags convert_emps``: the EMPS benchmark as session bags."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from session_bags.measured import DAY, EPOCH, converter, drive_session, load
from stage_core import topics
from stage_core.arrays import Array
from stage_core.clocks import to_stamps
from stage_core.session import Series, Session
from stage_core.twin_file import ServoAxis, TwinFile

#: Bag -> file; the second is the run with force pulses.
FILES = {'emps': 'DATA_EMPS.mat', 'emps_pulses': 'DATA_EMPS_PULSES.mat'}

#: Arrays of both files: time, reference, encoder and drive voltage (n, 1), and three gains.
NEEDED = ('t', 'qg', 'qm', 'vir', 'kp', 'kv', 'gtau')

#: Published mass (Janot, Gautier, Brunot 2019, table of the inverse identification) [kg].
MASS = 95.109


def nominal(record: dict[str, Array]) -> TwinFile:
    """The published mass alone, with the gains of the file: all else is for a diagnosis to find.

    The velocity is the encoder's difference; no limit of the force is published.
    """
    axis = ServoAxis(
        mass=MASS,
        viscous=0.0,
        encoder_resolution=5.0e-8,
        lead=0.0025,
        position_gain=record['kp'].item(),
        velocity_gain=record['kv'].item() * record['gtau'].item(),
        integral_gain=0.0,
        velocity_filter=1.0e4,
        force_limit=1.0e4,
    )
    return TwinFile(kind='servo', axes={'x': axis}, control_period=0.001)


def sessions(folder: Path) -> dict[str, Session]:
    """Both runs: effort = drive gain · drive voltage [N], velocity command = kp · (qg − qm).

    The pulses are added to the drive voltage. They are pulses / kv of velocity command, which the
    set-points of their ticks declare.
    """
    found = {}
    for number, (name, file) in enumerate(FILES.items()):
        record = load(folder / 'emps' / file, NEEDED, {'t': ('qg', 'qm', 'vir')})
        seconds, start = record['t'][:, 0], EPOCH + number * DAY
        reference, encoder = record['qg'], record['qm']
        velocity = record['kp'].item() * (reference - encoder)
        effort = record['gtau'].item() * record['vir']
        pulses = record.get('pulses_N', 0.0 * velocity)
        velocity = velocity + pulses / record['kv'].item()
        session = drive_session(name, seconds, start, reference, encoder, effort, velocity)
        pushed = pulses[:, 0] != 0.0
        if pushed.any():
            wanted = {'position': reference[pushed], 'velocity': velocity[pushed]}
            session.series[topics.SETPOINT] = Series.per_axis(
                topics.SETPOINT, to_stamps(seconds[pushed], start), **wanted
            )
        found[name] = replace(session, twin=nominal(record).to_dict())
    return found


main = converter('The EMPS benchmark as session bags.', sessions)
