"""What contour error 50 Hz over the Zaber wire can reach, at which feed.

    python benchmarks/zaber_feed.py

Stage twin (stepper, pseudo-terminal), driver and contour controller as processes, in real time.
Each feed: a circle of 4 mm radius, two iterations of `ccc+rilc` from the settings of
ros_ws/config/contour_ctrl_zaber.yaml. The error is that of the motor steps.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'tests'))

from domains import reserve_domain

from stage_core.errors import StageError
from stage_node.client_node import GraphClient

CONFIG = Path(__file__).resolve().parents[1] / 'ros_ws' / 'config'
FEEDS = (0.002, 0.004, 0.008, 0.016)


def start(module: str, *arguments: str) -> subprocess.Popen[bytes]:
    """Start a node."""
    command = [sys.executable, '-m', module, '--ros-args', '--log-level', 'fatal', *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def main() -> int:
    """Print one line per feed."""
    reserve_domain()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    processes = []
    with tempfile.TemporaryDirectory() as folder, GraphClient('zaber_feed') as client:
        link = Path(folder) / 'zaber'
        try:
            processes.append(
                start(
                    'stage_twin.node',
                    '-p',
                    f'twin:={CONFIG / "twin_stepper_reality.yaml"}',
                    '-p',
                    f'pty_link:={link}',
                    '-p',
                    'tracker_protocol:=none',
                )
            )
            deadline = time.monotonic() + 40.0
            while not link.exists() and time.monotonic() < deadline:
                time.sleep(0.1)
            processes.append(
                start(
                    'stage_driver.node',
                    '--params-file',
                    str(CONFIG / 'stage_driver_zaber.yaml'),
                    '-p',
                    f'port:={link}',
                )
            )
            processes.append(
                start(
                    'contour_ctrl.node',
                    '--params-file',
                    str(CONFIG / 'contour_ctrl_zaber.yaml'),
                    '-p',
                    'radius:=0.004',
                    '-p',
                    'iterations:=2',
                )
            )
            client.wait_for_service('/contour_ctrl/run', 60.0)
            print(client.trigger('/stage_driver/home', 60.0), flush=True)
            for feed in FEEDS:
                client.set_parameters('/contour_ctrl', feed=feed)
                try:
                    message = client.trigger('/contour_ctrl/run', 90.0)
                except StageError as error:
                    message = str(error)
                print(f'{1e3 * feed:g} mm/s: {message}', flush=True)
        finally:
            for process in reversed(processes):
                process.terminate()
            for process in processes:
                try:
                    process.wait(10.0)
                except subprocess.TimeoutExpired:
                    process.kill()
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
