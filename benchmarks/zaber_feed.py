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
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from stage_bringup.graph import Options
from stage_core.errors import StageError
from tests.domains import reserve_domain
from tests.reliability.rig import running

NODES = ('stage_twin', 'stage_driver', 'contour_ctrl')
#: Longest wait for a service and for its answer [s].
PATIENCE = 600.0


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
    with tempfile.TemporaryDirectory() as folder:
        options = Options(
            backend='zaber',
            clock='lockstep' if given.lockstep else 'realtime',
            out=Path(folder) / 'out',
            iterations=given.iterations,
        )
        # The emulated chain links its terminal there.
        options.out.mkdir()
        plant = {'tracker_protocol': 'none'}
        with running(options, *NODES, lean=True, stage_twin=plant, contour_ctrl=overrides) as (
            nodes,
            watch,
        ):
            client = watch.client
            for service in ('/stage_driver/home', '/contour_ctrl/run'):
                client.wait_for_service(service, PATIENCE, nodes.check)
            print(client.trigger('/stage_driver/home', PATIENCE), flush=True)
            for feed in given.feeds:
                client.set_parameters('/contour_ctrl', feed=1e-3 * feed)
                try:
                    message = client.trigger('/contour_ctrl/run', PATIENCE)
                except StageError as error:
                    message = str(error)
                print(f'{feed:g} mm/s: {message}', flush=True)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
