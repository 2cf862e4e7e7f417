"""The contour controller against the servo twin in another process, over DDS.

    python benchmarks/realtime_contour.py [--lockstep]

Real time: 1 kHz, prints the figures and the timing that the node reports on /diagnostics.
Lockstep: two fresh graphs; prints both results, which must be equal.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import time
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'tests'))

from domains import reserve_domain

from stage_core import topics
from stage_node.client_node import GraphClient

CONFIG = Path(__file__).resolve().parents[1] / 'ros_ws' / 'config'


def run(lockstep: bool) -> str:
    """Start twin, driver and controller; run once; return the message."""
    reserve_domain()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    port = str(random.randint(20000, 30000))
    sim = ['-p', f'use_sim_time:={str(lockstep).lower()}']
    commands = [
        [
            'stage_twin.node',
            '-p',
            f'twin:={CONFIG / "twin_reality.yaml"}',
            '-p',
            f'clock:={"lockstep" if lockstep else "realtime"}',
            '-p',
            f'drive_port:={port}',
            '-p',
            'tracker_protocol:=none',
        ],
        ['stage_driver.node', '-p', f'drive_port:={port}', *sim],
        [
            'contour_ctrl.node',
            '--params-file',
            str(CONFIG / 'contour_ctrl.yaml'),
            '-p',
            'iterations:=3',
            *sim,
        ],
    ]
    processes = [
        subprocess.Popen(
            [sys.executable, '-m', module, '--ros-args', '--log-level', 'fatal', *arguments],
            stdout=subprocess.DEVNULL,
        )
        for module, *arguments in commands
    ]
    timing: dict[str, str] = {}

    def on_diagnostics(message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == 'contour_ctrl: timing':
                timing.update({pair.key: pair.value for pair in status.values})

    try:
        with GraphClient('realtime_contour', use_sim_time=lockstep) as client:
            client.watch(DiagnosticArray, topics.DIAGNOSTICS, callback=on_diagnostics)
            client.wait_for_service('/contour_ctrl/run', 60.0)
            client.wait_for_service('/stage_driver/home', 60.0)
            time.sleep(2.0)
            client.trigger('/stage_driver/home', 60.0)
            message = client.trigger('/contour_ctrl/run', 120.0)
            time.sleep(1.5)
        if not lockstep:
            print(', '.join(f'{key} {value}' for key, value in timing.items()))
        return message
    finally:
        for process in reversed(processes):
            process.terminate()
        for process in processes:
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()


def main() -> int:
    """Run and print; exit 1 where lockstep results differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--lockstep', action='store_true')
    given = parser.parse_args()
    first = run(given.lockstep)
    print(first)
    if not given.lockstep:
        return 0
    second = run(True)
    print(second)
    print('equal' if first == second else 'DIFFERENT')
    return int(first != second)


if __name__ == '__main__':
    raise SystemExit(main())
