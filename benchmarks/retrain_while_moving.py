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
import sys
import tempfile
from pathlib import Path

import numpy as np
from rclpy.task import Future
from std_srvs.srv import Trigger

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from session_bags.writer import write_session
from stage_bringup.graph import Options
from stage_core import topics
from stage_core.session import Series, Session, by_topic
from tests.domains import reserve_domain
from tests.reliability.rig import Watch, running

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
    series = by_topic(
        Series.per_axis(topics.REFERENCE, stamps, position=path),
        Series.per_axis(topics.JOINT_STATES, stamps, position=table),
    )
    return write_session(folder / 'bag', Session('moving', series))


def _step(watch: Watch) -> int:
    """Iteration of the training, of its status `(iteration, error)`; 0 where there is none."""
    digits = watch.value('calibrator: model', 'training').strip('(').split(',')[0]
    return int(digits) if digits.isdigit() else 0


def _counts(watch: Watch) -> dict[str, int]:
    """What the nodes have counted."""
    return {
        f'{name.split(":")[0]} {key}': int(float(state[2][key]))
        for name, state in list(watch.states.items())
        for key in COUNTED
        if key in state[2]
    }


def _begin_training(watch: Watch, bag: Path) -> Future:
    """A training that would last for hours, once it has done an iteration."""
    watch.client.set_parameters(
        '/calibrator',
        bag=str(bag),
        method='it2fls',
        target='encoder',
        options='{"rules": 5, "particles": 200, "iterations": 1000000}',
    )
    retrain = watch.client.node.create_client(Trigger, '/calibrator/retrain')
    answer = retrain.call_async(Trigger.Request())
    watch.wait(lambda: _step(watch) > 0, 'the training')
    return answer


def _end_training(watch: Watch, answer: Future, begun: int) -> int:
    """A later iteration of the training than `begun`, 0 if it had ended by itself."""
    watch.wait(lambda: _step(watch) > begun, 'a later iteration')
    later = 0 if answer.done() else _step(watch)
    watch.client.trigger('/calibrator/abort', PATIENCE)
    watch.wait(answer.done, 'the abort')
    return later


def follow(
    folder: Path, bag: Path, clock: str, iterations: int, retrain: bool
) -> tuple[str, dict[str, int], tuple[int, int]]:
    """Result of the run, what the nodes counted, and the swarm's iteration before and after it."""
    folder.mkdir()
    options = Options(clock=clock, out=folder / 'out', iterations=iterations)
    with running(options, *NODES, lean=True, **CHANGED) as (nodes, watch):
        client = watch.client
        for service in ('/contour_ctrl/run', '/stage_driver/home', '/calibrator/retrain'):
            client.wait_for_service(service, PATIENCE)
        watch.wait(lambda: client.node.get_clock().now().nanoseconds > 0, 'a plant')
        client.trigger('/stage_driver/home', PATIENCE)
        answer = _begin_training(watch, bag) if retrain else None
        begun = _step(watch)
        message = client.trigger('/contour_ctrl/run', PATIENCE)
        later = 0 if answer is None else _end_training(watch, answer, begun)
        for line in nodes.log('stage_driver').splitlines():
            if 'stream ended' in line:
                print(f'  driver: {line}')
        return message, _counts(watch), (begun, later)


def main() -> int:
    """Follow the contour twice and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--realtime', action='store_true')
    parser.add_argument('--iterations', type=int, default=2, help='of the contour')
    given = parser.parse_args()
    clock = 'realtime' if given.realtime else 'lockstep'
    reserve_domain()
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
