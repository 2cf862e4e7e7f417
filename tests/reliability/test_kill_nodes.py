"""kill -9 of every node of the whole graph, during a move and during a stream."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from session_bags.reader import read_session
from session_bags.repair import repair
from stage_core import topics
from stage_core.errors import StageError

from .rig import PATIENCE, Nodes, Watch, restart

#: Feed of a contour that lasts longer than anything that is done to it [m/s].
SLOW = 0.01


@pytest.fixture(scope='module')
def whole(graph: Callable[..., Any]) -> Iterator[tuple[Nodes, Watch]]:
    """The graph of a session in lockstep, with short give-up times."""
    with graph(
        stage_twin={'lockstep_watchdog': 3.0},
        stage_driver={'lockstep_timeout': 2.0, 'settle_time': 0.3},
        contour_ctrl={
            'lockstep_timeout': 4.0,
            'iterations': 1,
            'scheme': 'p_ff',
            'radius': 0.02,
            'feed': 0.05,
        },
        session_recorder={'name': 'killed'},
    ) as (nodes, watch):
        for name in ('tracker_bridge', 'session_recorder', 'calibrator', 'contour_ctrl'):
            watch.wait(lambda name=name: watch.heard(name), f'{name} on /diagnostics')
        watch.wait(lambda: _all_know_each_other(watch), 'discovery')
        yield nodes, watch


@pytest.fixture
def ready(whole: tuple[Nodes, Watch]) -> tuple[Nodes, Watch]:
    """The graph with every node alive and the stage homed."""
    nodes, watch = whole
    assert nodes.dead() == []
    watch.home()
    return whole


def _all_know_each_other(watch: Watch) -> bool:
    peers = [s for name, s in list(watch.states.items()) if name.endswith(': peers')]
    return len(peers) == 7 and all('not heard yet' not in s[2].values() for s in peers)


class Contour:
    """`~/run` in a thread; its message or its reason."""

    def __init__(self, watch: Watch, feed: float = 0.05) -> None:
        watch.client.set_parameters('/contour_ctrl', PATIENCE, feed=feed)
        self.message = self.failure = ''
        self._watch = watch
        # A daemon: nobody answers it where the controller is killed.
        self._thread = threading.Thread(target=self._run, daemon=True)
        watch.streamed.clear()
        self._thread.start()
        # A diagnostic sentence may be a second old: the set-points themselves tell the stream, by
        # their stamps, for a busy machine shows only some of them to the test.
        watch.wait(lambda: watch.streamed_time() > 0.2, 'the stream')

    def _run(self) -> None:
        try:
            self.message = self._watch.client.trigger('/contour_ctrl/run', 2 * PATIENCE)
        except StageError as error:
            self.failure = str(error)

    def end(self) -> None:
        self._thread.join(2 * PATIENCE)


def test_kill_of_bystanders_during_moves(ready: tuple[Nodes, Watch]) -> None:
    nodes, watch = ready
    path = Path(watch.client.trigger('/session_recorder/start', PATIENCE))
    target = 0.03
    victims = ('tracker_bridge', 'calibrator', 'gap_diagnosis', 'session_recorder')
    for victim in victims:
        watch.move_until_moving(target, 0.01)
        nodes.kill(victim)
        # The move goes on to its end and the stage rests at its target.
        watch.wait(watch.arrived(target, 0.01), f'the end of the move without {victim}')
        watch.rest(watch.encoder)
        target = -target
        if victim != 'session_recorder':
            assert set(nodes.dead()) == set(victims[: victims.index(victim) + 1])
    watch.wait(watch.missed('calibrator'), 'the calibrator missed')
    # What was recorded before the kill is there and is repaired.
    (done,) = repair(path)
    assert not done.was_whole
    assert len(read_session(path).series[topics.REFERENCE]) > 100
    restart(nodes, watch, *victims)
    count = len(watch.tracker)
    watch.move_until_moving(target, 0.0)
    watch.wait(lambda: len(watch.tracker) > count + 20, 'tracker points of the new bridge')
    watch.wait(watch.arrived(target, 0.0), 'the move')
    again = Path(watch.client.trigger('/session_recorder/start', PATIENCE))
    assert again != path and path.exists()
    watch.client.trigger('/session_recorder/stop', PATIENCE)


def test_kill_of_bystanders_during_a_stream(ready: tuple[Nodes, Watch]) -> None:
    nodes, watch = ready
    run = Contour(watch)
    for victim in ('calibrator', 'tracker_bridge', 'session_recorder', 'gap_diagnosis'):
        nodes.kill(victim)
    run.end()
    assert '1 iteration' in run.message, run.failure
    watch.rest(watch.encoder)
    restart(nodes, watch, 'calibrator', 'tracker_bridge', 'session_recorder', 'gap_diagnosis')


def test_kill_of_the_controller_during_a_stream(ready: tuple[Nodes, Watch]) -> None:
    nodes, watch = ready
    before = int(watch.value('stage_driver: state', 'watchdog_stops') or 0)
    Contour(watch, SLOW)
    nodes.kill('contour_ctrl')
    watch.wait(
        lambda: int(watch.value('stage_driver: state', 'watchdog_stops') or 0) > before,
        'the watchdog of the driver',
    )
    watch.rest(watch.encoder)
    watch.wait(watch.says('stage_driver: state', 'ready'), 'readiness')
    watch.wait(watch.missed('contour_ctrl'), 'the controller missed')
    restart(nodes, watch, 'contour_ctrl')
    run = Contour(watch)
    run.end()
    assert '1 iteration' in run.message, run.failure


# In a move the driver is killed in test_stage_safety.py, in real time.
def test_kill_of_the_driver_during_a_stream(ready: tuple[Nodes, Watch]) -> None:
    nodes, watch = ready
    run = Contour(watch, SLOW)
    last = len(watch.tracker)
    nodes.kill('stage_driver')
    # Time stands still until the drive's own brake cuts in; the tracker sees the stage stop.
    watch.wait(watch.missed('stage_driver'), 'the driver missed')
    watch.wait(lambda: len(watch.tracker) > last, 'points while the drive brakes')
    watch.rest(watch.tracker, 4.0, 3)
    run.end()
    assert 'no encoder message' in run.failure or 'does not answer' in run.failure
    assert nodes.dead() == ['stage_driver']
    restart(nodes, watch, 'stage_driver')
    watch.home()
    watch.move(0.01, 0.01)
    watch.wait(watch.arrived(0.01, 0.01), 'a move with the new driver')


# In a stream the plant is killed by benchmarks/soak_kill.py.
def test_kill_of_the_plant_during_a_move(ready: tuple[Nodes, Watch]) -> None:
    nodes, watch = ready
    watch.move_until_moving(-0.05 if watch.encoder[-1][1] > 0 else 0.05, 0.0)
    nodes.kill('stage_twin')
    watch.wait(watch.says('stage_driver: state', 'no encoder datagram'), 'the fault')
    watch.wait(watch.says('tracker_bridge: connection', 'no tracker'), 'the tracker missed')
    assert nodes.dead() == ['stage_twin']
    # A fault is latched: the drive that comes back is not moved until somebody asks for it.
    restart(nodes, watch, 'stage_twin')
    watch.wait(watch.says('tracker_bridge: connection', 'connected'), 'the tracker')
    count = len(watch.encoder)
    watch.move(0.02, 0.0)
    watch.wait(watch.says('stage_driver: set-points', 'in fault', 'not homed'), 'the refusal')
    assert all(abs(row[1]) < 1e-5 for row in list(watch.encoder)[count:])
    watch.home()
    watch.move(0.01, 0.01)
    watch.wait(watch.arrived(0.01, 0.01), 'a move of the new plant')
