"""How long `~/stop` takes to answer while set-points stream at 1 kHz.

    nice -n 10 .venv/bin/python benchmarks/bench_stop.py

Starts a real twin and a real driver; prints percentiles of the answer times and the driver's
own counters.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'tests'))

from domains import reserve_domain

from stage_core import topics
from stage_core.ros.client_node import GraphClient
from stage_core.ros.node import SETPOINT_QOS, joint_state

PORT = 20799
CALLS = 200


def start(module: str, *parameters: str) -> subprocess.Popen[bytes]:
    """Start a node with `name:=value` parameters."""
    options = [text for parameter in parameters for text in ('-p', parameter)]
    return subprocess.Popen([sys.executable, '-m', module, '--ros-args', *options])


def stream(client: GraphClient, ended: threading.Event) -> None:
    """Publish velocity set-points at 1 kHz, turning the direction twice a second."""
    publisher = client.node.create_publisher(JointState, topics.SETPOINT, SETPOINT_QOS)
    begin = due = time.monotonic()
    while not ended.is_set():
        speed = 0.02 if int(2 * (time.monotonic() - begin)) % 2 else -0.02
        publisher.publish(joint_state(0, ['x', 'y'], velocity=[speed, -speed]))
        due += 0.001
        time.sleep(max(0.0, due - time.monotonic()))


def answer_times(client: GraphClient) -> np.ndarray:
    """Durations [s] of CALLS calls of `~/stop`."""
    stop = client.node.create_client(Trigger, '/stage_driver/stop')
    stop.wait_for_service(30.0)
    durations = np.empty(CALLS)
    for index in range(CALLS):
        done = threading.Event()
        begin = time.perf_counter()
        stop.call_async(Trigger.Request()).add_done_callback(lambda _, done=done: done.set())
        done.wait(10.0)
        durations[index] = time.perf_counter() - begin
        time.sleep(0.02)
    return durations


def driver_counters(client: GraphClient) -> str:
    """Ticks and missed ticks from the driver's diagnostics."""

    def found() -> dict[str, str] | None:
        message = client.latest(topics.DIAGNOSTICS)
        for status in message.status if message is not None else ():
            if status.name == 'stage_driver: state':
                return {value.key: value.value for value in status.values}
        return None

    client.wait_for(lambda: found() is not None, 10.0, 'diagnostics of the driver')
    values = found() or {}
    return f'ticks {values["tick"]}, missed ticks {values["missed_ticks"]}'


def main() -> None:
    """Run the graph and print the table."""
    reserve_domain()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    nodes = [
        start('stage_twin.node', f'drive_port:={PORT}', 'tracker_protocol:=none'),
        start('stage_driver.node', f'drive_port:={PORT}', 'home_required:=false'),
    ]
    ended = threading.Event()
    try:
        with GraphClient('bench_stop') as client:
            client.watch(JointState, topics.JOINT_STATES)
            client.watch(DiagnosticArray, topics.DIAGNOSTICS)
            client.wait_for(lambda: client.latest(topics.JOINT_STATES) is not None, 180, 'states')
            streaming = threading.Thread(target=stream, args=(client, ended))
            streaming.start()
            durations = 1e3 * answer_times(client)
            ended.set()
            streaming.join()
            counters = driver_counters(client)
            values = np.percentile(durations, (50, 95, 99, 100))
            print(
                '~/stop during a 1 kHz stream: median {:.1f} ms, 95 % {:.1f} ms, '
                '99 % {:.1f} ms, worst {:.1f} ms'.format(*values)
            )
            print(f'driver: {counters}')
    finally:
        ended.set()
        for node in reversed(nodes):
            node.terminate()
        for node in nodes:
            # One that does not end on a loaded machine must not keep the other alive.
            try:
                node.wait(30)
            except subprocess.TimeoutExpired:
                node.kill()
                node.wait()


if __name__ == '__main__':
    main()
