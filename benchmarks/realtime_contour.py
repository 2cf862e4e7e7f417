"""The contour controller against the servo twin in another process, over DDS.

    python benchmarks/realtime_contour.py [--runs 10] [--composed] [--awake] [--priority]

1 kHz in real time; prints the figures, the timing that the node reports on /diagnostics, what the
other two nodes count, and what the machine itself left out: gaps in which a processor ran nothing,
and on a virtual machine the processor time that its host kept.
--awake: the processors are kept awake. --priority: with real-time priority, where the system
permits it. --lockstep: the same contour in lockstep, to compare with. Exit status 1 where a run
failed.
--composed: driver and controller in one process (`ros2 run stage_bringup control`).
"""

from __future__ import annotations

import argparse
import os
import socket
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'tests'))

from domains import reserve_domain
from processor_gaps import ProcessorGaps

from stage_bringup.graph import composed, config_folder, free_port
from stage_bringup.keep_awake import KeepAwake
from stage_bringup.processes import NodeCommand, Processes
from stage_core import topics
from stage_core.errors import StageError
from stage_core.ros.client_node import GraphClient

#: Longest wait for a service and for its answer [s].
PATIENCE = 240.0
#: What the other two count of a machine that is late, over their whole life.
COUNTED = {
    'stage_twin: plant': ('held_ticks', 'late_forces', 'missed_ticks', 'pauses', 'worst_lateness'),
    'stage_driver: state': ('missed_ticks', 'late_ticks'),
}


def nodes(priority: bool, together: bool, lockstep: bool) -> list[NodeCommand]:
    """Twin, driver and controller; the last two in one process where they are `together`."""
    port = free_port(socket.SOCK_DGRAM)
    # Who is waited for goes first: the plant, then the driver, then the controller.
    first, second, third = (45, 40, 35) if priority else (0, 0, 0)
    plant = {
        'thread_priority': first,
        'twin': config_folder() / 'twin_reality.yaml',
        'clock': 'lockstep' if lockstep else 'realtime',
        'drive_port': port,
        'tracker_protocol': 'none',
    }
    timed = {'use_sim_time': True} if lockstep else {}
    driver = {'drive_port': port, 'thread_priority': second, **timed}
    found = [
        NodeCommand('stage_twin', 'stage_twin.node', plant),
        NodeCommand('stage_driver', 'stage_driver.node', driver),
        NodeCommand(
            'contour_ctrl',
            'contour_ctrl.node',
            {'iterations': 3, 'thread_priority': third, **timed},
            (config_folder() / 'contour_ctrl.yaml',),
        ),
    ]
    return composed(found) if together else found


class Told:
    """What the nodes tell on /diagnostics: the controller's timing, and what the others count."""

    def __init__(self) -> None:
        self.timing: dict[str, str] = {}
        self.waits: dict[str, str] = {}

    def hear(self, message: DiagnosticArray) -> None:
        """Take a message."""
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            if status.name == 'contour_ctrl: timing':
                self.timing.update(values, status=status.message)
            if counted := COUNTED.get(status.name):
                shown = ', '.join(f'{key} {values.get(key, "-")}' for key in counted)
                self.waits[status.name] = shown

    def show(self, gaps: str) -> None:
        """Print it beside what the machine left out."""
        print(', '.join(f'{key} {value}' for key, value in self.timing.items()))
        print('; '.join(f'{name} {text}' for name, text in self.waits.items()))
        print(gaps)


def run(priority: bool, together: bool, lockstep: bool) -> str:
    """Start twin, driver and controller; run once; return the message."""
    reserve_domain()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    told, message, failure = Told(), '', None
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        processes = Processes(Path(folder))
        stack.callback(processes.end, 10.0)
        for command in nodes(priority, together, lockstep):
            processes.start(command)
        client = stack.enter_context(GraphClient('realtime_contour', use_sim_time=lockstep))
        client.watch(DiagnosticArray, topics.DIAGNOSTICS, callback=told.hear)
        for service in ('/stage_driver/home', '/contour_ctrl/run'):
            client.wait_for_service(service, PATIENCE, processes.check)
        client.trigger('/stage_driver/home', PATIENCE)
        with ProcessorGaps() as gaps:
            try:
                message = client.trigger('/contour_ctrl/run', PATIENCE)
            except StageError as error:
                # On a machine too slow for 1 kHz the timing shows by how much.
                failure = error
        # What was reported during the run does not hold its last ticks.
        told.timing.clear()
        client.wait_for(lambda: 'status' in told.timing, PATIENCE, 'the timing on /diagnostics')
        told.show(gaps.text)
    if failure is not None:
        raise failure
    return message


def main() -> int:
    """Run and print; exit 1 where a run failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--runs', type=int, default=1, help='how often')
    parser.add_argument('--priority', action='store_true', help='with real-time priority')
    parser.add_argument('--awake', action='store_true', help='the processors are kept awake')
    parser.add_argument('--lockstep', action='store_true', help='in lockstep, to compare with')
    parser.add_argument(
        '--composed', action='store_true', help='driver and controller in one process'
    )
    given = parser.parse_args()
    failed = 0
    with ExitStack() as stack:
        if given.awake:
            print(f'the processors are kept awake: {stack.enter_context(KeepAwake()).how}')
        for _ in range(given.runs):
            try:
                print(run(given.priority, given.composed, given.lockstep), flush=True)
            except StageError as error:
                print(f'error: {error}', flush=True)
                failed += 1
    if given.runs > 1:
        print(f'{given.runs - failed} of {given.runs} runs succeeded')
    return int(failed > 0)


if __name__ == '__main__':
    raise SystemExit(main())
