"""What a retrain does to the motion of the stage: the same contour without one and during one.

A graph of twin, driver, contour controller and calibrator, each a process, started anew for each
run. While the circle is followed, the calibrator trains a large swarm on all processors, and
is aborted afterwards. In lockstep both runs must give the same figures to the last digit (exit
status 1 where they do not, or where the training did not last through the motion). In real time
the two are printed with the ticks that were missed.

    python benchmarks/retrain_while_moving.py [--realtime] [--iterations 2]
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.task import Future
from std_srvs.srv import Trigger

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'tests'))

from domains import reserve_domain

from session_bags.writer import write_session
from stage_bringup.graph import Options, commands
from stage_bringup.processes import Processes
from stage_core import topics
from stage_core.ros.client_node import GraphClient
from stage_core.session import Series, Session

NODES = ('stage_twin', 'stage_driver', 'calibrator', 'contour_ctrl')
COUNTED = ('missed_ticks', 'held_ticks', 'watchdog_stops')
PATIENCE = 300.0
#: In lockstep a tick may take what a loaded machine needs for it [s of wall time].
CHANGED: dict[str, dict[str, object]] = {
    'stage_twin': {'tracker_protocol': 'none', 'lockstep_watchdog': 120.0},
    'stage_driver': {'lockstep_timeout': 60.0},
    'contour_ctrl': {'lockstep_timeout': 240.0},
}


def training_bag(folder: Path) -> Path:
    """A moving stage with smooth errors: enough samples for a long training."""
    times = np.arange(20_000)
    stamps = 10**18 + times * 2_000_000
    path = 0.05 * np.sin(np.outer(times * 0.002, (1.9, 3.1)))
    table = path + 2e-5 * np.sin(90.0 * path)
    return write_session(
        folder / 'bag',
        Session(
            'moving',
            {
                topics.REFERENCE: Series(
                    topics.REFERENCE, stamps, {'position.x': path[:, 0], 'position.y': path[:, 1]}
                ),
                topics.JOINT_STATES: Series(
                    topics.JOINT_STATES,
                    stamps,
                    {'position.x': table[:, 0], 'position.y': table[:, 1]},
                ),
            },
        ),
    )


class _Told:
    """What the nodes say of themselves: what they counted, and how far the training is."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self._training = ''

    def keep(self, message: DiagnosticArray) -> None:
        """Take what a node has published."""
        for part in message.status:
            node = part.name.split(':')[0]
            for pair in part.values:
                if pair.key in COUNTED and node in NODES:
                    self.counts[f'{node} {pair.key}'] = int(float(pair.value))
                if part.name == 'calibrator: model' and pair.key == 'training':
                    self._training = pair.value

    def step(self) -> int:
        """Iteration of the training, of its status `(iteration, error)`; 0 where there is none."""
        digits = self._training.strip('(').split(',')[0]
        return int(digits) if digits.isdigit() else 0


def _begin_training(client: GraphClient, bag: Path, told: _Told) -> Future:
    """A training that would last for hours, once it has done an iteration."""
    client.set_parameters(
        '/calibrator',
        bag=str(bag),
        method='it2fls',
        target='encoder',
        options='{"rules": 5, "particles": 200, "iterations": 1000000}',
    )
    retrain = client.node.create_client(Trigger, '/calibrator/retrain')
    answer = retrain.call_async(Trigger.Request())
    client.wait_for(lambda: told.step() > 0, PATIENCE, 'the training')
    return answer


def _end_training(client: GraphClient, answer: Future, told: _Told, begun: int) -> int:
    """A later iteration of the training than `begun`, 0 if it had ended by itself."""
    client.wait_for(lambda: told.step() > begun, PATIENCE, 'a later iteration')
    later = 0 if answer.done() else told.step()
    client.trigger('/calibrator/abort', PATIENCE)
    client.wait_for(answer.done, PATIENCE, 'the abort')
    return later


def follow(
    folder: Path, bag: Path, clock: str, iterations: int, retrain: bool
) -> tuple[str, dict[str, int], tuple[int, int]]:
    """Result of the run, what the nodes counted, and the swarm's iteration before and after it."""
    folder.mkdir()
    told = _Told()
    processes = Processes(folder / 'log')
    options = Options(clock=clock, out=folder / 'out', iterations=iterations)
    try:
        for command in commands(options):
            if command.name in NODES:
                changed = {**command.parameters, **CHANGED.get(command.name, {})}
                processes.start(replace(command, parameters=changed))
        with GraphClient('retrain_while_moving', use_sim_time=clock == 'lockstep') as client:
            client.watch(DiagnosticArray, topics.DIAGNOSTICS, callback=told.keep)
            for service in ('/contour_ctrl/run', '/stage_driver/home', '/calibrator/retrain'):
                client.wait_for_service(service, PATIENCE)
            client.wait_for(
                lambda: client.node.get_clock().now().nanoseconds > 0, PATIENCE, 'a plant'
            )
            client.trigger('/stage_driver/home', PATIENCE)
            answer = _begin_training(client, bag, told) if retrain else None
            begun = told.step()
            message = client.trigger('/contour_ctrl/run', PATIENCE)
            later = 0 if answer is None else _end_training(client, answer, told, begun)
        for line in (folder / 'log' / 'stage_driver.log').read_text(errors='replace').splitlines():
            if 'stream ended' in line:
                print(f'  driver: {line}')
        return message, told.counts, (begun, later)
    finally:
        processes.end()


def main() -> int:
    """Follow the contour twice and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--realtime', action='store_true')
    parser.add_argument('--iterations', type=int, default=2, help='of the contour')
    given = parser.parse_args()
    clock = 'realtime' if given.realtime else 'lockstep'
    reserve_domain()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    with tempfile.TemporaryDirectory() as name:
        bag = training_bag(Path(name))
        results = []
        for retrain in (False, True):
            folder = Path(name) / ('retrain' if retrain else 'alone')
            message, counts, steps = follow(folder, bag, clock, given.iterations, retrain)
            results.append((message, counts))
            print('during a retrain:' if retrain else 'without a retrain:')
            print(f'  {message}')
            if retrain:
                print(f'  swarm iterations {steps[0]} to {steps[1]} during the motion')
            if given.realtime:
                print('  ' + ', '.join(f'{key} {value}' for key, value in sorted(counts.items())))
    stops = [sum(v for key, v in counts.items() if 'watchdog' in key) for _, counts in results]
    print(f'watchdog stops: {stops[0]} without, {stops[1]} during')
    if given.realtime:
        return 0
    same = results[0][0] == results[1][0] and steps[1] > steps[0] and stops[0] == stops[1]
    print('equal' if same else 'DIFFERENT')
    return int(not same)


if __name__ == '__main__':
    sys.exit(main())
