"""What contour error 50 Hz over the Zaber wire can reach, at which feed.

    python benchmarks/zaber_feed.py [--lockstep] [--radius 4] [--feeds 2 4 8 16]
        [--iterations 5] [--set x.position_gain=8.0 ...]

Stage twin (stepper, pseudo-terminal), driver and contour controller as processes, in real time or
in lockstep. Each feed [mm/s]: a circle of that radius [mm], followed as often as asked with
`ccc+rilc` and the settings of ros_ws/config/contour_ctrl_zaber.yaml. The error is that of the
motor steps.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'tests'))

from domains import reserve_domain

from stage_bringup.graph import Options, commands, zaber_port
from stage_bringup.processes import Processes
from stage_core.errors import StageError
from stage_core.ros.client_node import GraphClient

NODES = ('stage_twin', 'stage_driver', 'contour_ctrl')
#: Longest wait for a service and for its answer [s].
PATIENCE = 600.0


def start(processes: Processes, options: Options, overrides: dict[str, str]) -> None:
    """Start the three nodes; the driver opens its port at once, so the twin must be there."""
    own = {'stage_twin': {'tracker_protocol': 'none'}, 'contour_ctrl': overrides}
    for command in commands(options):
        if command.name in NODES:
            parameters = {**command.parameters, **own.get(command.name, {})}
            processes.start(replace(command, parameters=parameters))
            while command.name == 'stage_twin' and not zaber_port(options).exists():
                processes.check()
                time.sleep(0.1)


def main() -> int:
    """Print one line per feed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--lockstep', action='store_true')
    parser.add_argument('--radius', type=float, default=4.0, help='mm')
    parser.add_argument('--feeds', type=float, nargs='+', default=[2.0, 4.0, 8.0, 16.0])
    parser.add_argument('--iterations', type=int, default=5)
    parser.add_argument('--set', nargs='*', default=[], help='parameters of contour_ctrl')
    given = parser.parse_args()
    overrides = {'radius': str(1e-3 * given.radius)}
    overrides |= dict(pair.split('=', 1) for pair in given.set)
    reserve_domain()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    with tempfile.TemporaryDirectory() as folder:
        processes = Processes(Path(folder) / 'log')
        options = Options(
            backend='zaber',
            clock='lockstep' if given.lockstep else 'realtime',
            out=Path(folder),
            iterations=given.iterations,
        )
        try:
            start(processes, options, overrides)
            with GraphClient('zaber_feed', use_sim_time=given.lockstep) as client:
                for service in ('/stage_driver/home', '/contour_ctrl/run'):
                    client.wait_for_service(service, PATIENCE, processes.check)
                print(client.trigger('/stage_driver/home', PATIENCE), flush=True)
                for feed in given.feeds:
                    client.set_parameters('/contour_ctrl', feed=1e-3 * feed)
                    try:
                        message = client.trigger('/contour_ctrl/run', PATIENCE)
                    except StageError as error:
                        message = str(error)
                    print(f'{feed:g} mm/s: {message}', flush=True)
        finally:
            processes.end()
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
