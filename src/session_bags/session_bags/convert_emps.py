"""``ros2 run session_bags convert_emps``: the EMPS benchmark as session bags."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from session_bags.measured import DAY, EPOCH, convert, drive_session, load
from stage_core.errors import command_line
from stage_core.session import Session
from stage_core.twin_file import ForceAxis, TwinFile

#: Bag -> file; the second is the run with force pulses.
_FILES = {'emps': 'DATA_EMPS.mat', 'emps_pulses': 'DATA_EMPS_PULSES.mat'}

#: Published estimate of mass and viscous friction (Janot, Gautier, Brunot 2019, table of the
#: inverse identification); 0.05 µm encoder, 2.5 mm per motor turn.
NOMINAL = ForceAxis(mass=95.109, viscous=203.50, encoder_resolution=5.0e-8, lead=0.0025)


def sessions(folder: Path) -> dict[str, Session]:
    """Both runs: effort = drive gain · drive voltage [N], velocity command = kp · (qg − qm)."""
    twin = TwinFile(kind='measured_force', axes={'x': NOMINAL}, control_period=0.001).to_dict()
    found = {}
    for number, (name, file) in enumerate(_FILES.items()):
        record = load(folder / 'emps' / file)
        reference, encoder = record['qg'], record['qm']
        session = drive_session(
            name,
            record['t'][:, 0],
            EPOCH + number * DAY,
            reference,
            encoder,
            record['gtau'].item() * record['vir'],
            record['kp'].item() * (reference - encoder),
        )
        found[name] = replace(session, twin=twin)
    return found


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Convert both runs."""
    return convert('The EMPS benchmark as session bags.', sessions, arguments)


if __name__ == '__main__':
    sys.exit(main())
