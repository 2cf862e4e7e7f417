"""Calibrate a stage whose nodes are running: home, align the tracker, record, retrain, activate.

    .venv/bin/python examples/calibrate_stage.py --centre 0.05 0.05 --half-range 0.03

Moves the stage within centre +- half range [m]. The nodes stage_driver, tracker_bridge,
session_recorder and calibrator must run (docs/guide/real_machine.md); --clock is theirs.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from stage_bringup.client_node import SessionClient
from stage_bringup.plan import alignment_points, calibration_grid
from stage_core.errors import StageError, command_line


@command_line
def main() -> int:
    """Run the steps and print each answer."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--centre', nargs=2, type=float, default=(0.05, 0.05), help='m')
    parser.add_argument('--half-range', type=float, default=0.03, help='m')
    parser.add_argument('--grid', type=int, default=5, help='points per side, visited twice')
    parser.add_argument('--settle', type=float, default=0.5, help='rest at each position, s')
    parser.add_argument('--clock', choices=('realtime', 'lockstep'), default='realtime')
    given = parser.parse_args()
    if given.grid < 3:
        parser.error('--grid must be 3 or more: four places do not prove a model')
    centre = np.array(given.centre)
    with SessionClient(given.settle, given.clock == 'lockstep') as client:

        def visit(points: np.ndarray) -> None:
            for point in centre + points:
                client.go_to(point, timeout=60.0, alive=lambda: None)

        client.set_bool('/calibrator/activate', False)
        print(client.trigger('/stage_driver/home', 120.0))
        client.trigger('/tracker_bridge/reset')
        visit(alignment_points(given.half_range))
        print(client.trigger('/tracker_bridge/align', 60.0))
        bag = client.trigger('/session_recorder/start')
        visit(calibration_grid(given.half_range, given.grid))
        print(client.trigger('/session_recorder/stop'))
        client.set_parameters('/calibrator', bag=bag)
        try:
            print(client.trigger('/calibrator/retrain', 600.0))
        except StageError as error:
            raise StageError(
                f'{error}. The correction is off: `ros2 service call /calibrator/activate '
                'std_srvs/srv/SetBool "{data: true}"` puts an earlier model back'
            ) from error
        print(client.set_bool('/calibrator/activate', True))
    return 0


if __name__ == '__main__':
    sys.exit(main())
