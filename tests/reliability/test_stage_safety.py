"""Nobody moves the stage who should not: watchdog, limits, stop, tracker, in real time.

Deadlines are measured in the stage's own time, by the stamps of its messages.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from std_srvs.srv import Trigger

from stage_core.errors import StageError
from stage_core.twin_file import TwinFile

from .controller import SPEED, Controller
from .rig import PATIENCE, Nodes, Watch, last, spread

STOP_DECELERATION = 4.0
SETPOINT_TIMEOUT = 0.1
#: Travel while the velocity falls from SPEED to rest at the stop's deceleration.
STOP_DISTANCE = SPEED**2 / (2.0 * STOP_DECELERATION)
LIMIT = 0.15


@pytest.fixture(scope='module')
def stage(
    graph: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Nodes, Watch]]:
    """Plant, driver, bridge and calibrator in real time; a fast tracker."""
    fast = TwinFile.nominal_servo().to_dict()
    fast['tracker'] = {'rate': 1000.0, 'noise': 1e-7}
    twin = tmp_path_factory.mktemp('twin') / 'fast.yaml'
    TwinFile.from_dict(fast).save(twin)
    with graph(
        'stage_twin',
        'stage_driver',
        'tracker_bridge',
        'calibrator',
        clock='realtime',
        stage_twin={'twin': twin},
        stage_driver={'setpoint_timeout': SETPOINT_TIMEOUT},
    ) as (nodes, watch):
        watch.wait(lambda: len(watch.encoder) > 100, 'the encoder')
        watch.wait(lambda: 'calibrator: model' in watch.states, 'the calibrator')
        yield nodes, watch


@pytest.fixture
def ready(stage: tuple[Nodes, Watch]) -> Watch:
    """The stage homed, at rest at -30 mm."""
    nodes, watch = stage
    assert nodes.dead() == []
    if not nodes.usable:
        pytest.fail('the graph has not answered the test before this one')
    deadline = time.monotonic() + PATIENCE
    nodes.usable = False
    while time.monotonic() < deadline:
        try:
            watch.home()
            watch.move(-0.03, 0.0)
            watch.wait(watch.arrived(-0.03, 0.0), 'the start', 10.0)
        except AssertionError:
            # A machine that stands still for 20 ms makes the drive brake, as it should.
            continue
        nodes.usable = True
        return watch
    raise AssertionError('the stage cannot be brought to its start')


@pytest.fixture
def controller(ready: Watch) -> Iterator[Callable[..., Controller]]:
    """Maker of controllers, which are killed at the end."""
    made: list[Controller] = []

    def make(*arguments: Any) -> Controller:
        # Known before anything can fail, so that its process is ended whatever happens.
        made.append(Controller(*arguments))
        if len(made) == 1:
            made[-1].follow(ready, -0.02)
        return made[-1]

    yield make
    for one in made:
        one.end()


def at_rest(watch: Watch) -> bool:
    """Whether the last 100 ticks stayed within a few encoder counts."""
    rows = last(watch.encoder, 100)
    return len(rows) == 100 and spread(rows) < 1e-5


def last_refusal(watch: Watch) -> str:
    """Reason of the last refused set-point."""
    return watch.value('stage_driver: set-points', 'last_refusal')


def braking(watch: Watch, since: int) -> tuple[int, float, float]:
    """First tick [ns] of the stop after stamp `since`, its ticks as time [s] and travel [m]."""
    commands = np.array([row for row in list(watch.command) if row[0] >= since], dtype=float)
    rows = np.array([row for row in list(watch.encoder) if row[0] >= since], dtype=float)
    fast = np.abs(commands[:, 1]) > 0.97 * SPEED
    first = int(commands[np.flatnonzero(fast)[-1], 0])
    after = rows[rows[:, 0] >= first]
    # The last fifth of a millimetre is the position loop settling, not the stop.
    moving = np.abs(after[:, 1] - after[-1, 1]) > 2e-4
    ticks = np.flatnonzero(moving)[-1] if moving.any() else 0
    return first, 1e-3 * float(ticks), abs(float(after[-1, 1] - after[0, 1]))


@pytest.mark.parametrize(
    ('kind', 'death'),
    [('velocity', 'killed'), ('both', 'suspended'), ('both', 'nan')],
)
def test_watchdog_stops_within_the_deceleration_distance(
    ready: Watch, controller: Callable[..., Controller], kind: str, death: str
) -> None:
    one = controller(kind)
    since = ready.encoder[-1][0]
    if death == 'killed':
        one.process.kill()
    elif death == 'suspended':
        one.process.send_signal(signal.SIGSTOP)
    else:
        one.rubbish()
    ready.wait(lambda: at_rest(ready), 'rest')
    first, took, travel = braking(ready, since)
    # From the first tick of the stop on; the position loop's own lag is v / gain = 2.5 mm.
    assert travel < STOP_DISTANCE + SPEED / 40.0 + 5e-4
    assert took < SPEED / STOP_DECELERATION + 0.3
    if death != 'nan':
        # The watchdog counts ticks from the arrival of the last set-point on; stamps go on while
        # the plant of a busy machine stands still.
        ticks = sum(ready.streamed_at < row[0] <= first for row in list(ready.encoder))
        assert 1e-3 * ticks < SETPOINT_TIMEOUT + 0.25
        # A reference that stands still while its velocity goes on is a following error first.
        ready.wait(
            lambda: (
                int(ready.value('stage_driver: state', 'watchdog_stops') or 0) > 0
                or 'following error' in ready.text('stage_driver: state')
            ),
            'the reason on /diagnostics',
        )
    else:
        ready.wait(lambda: 'nan' in last_refusal(ready), 'the reason')
        # The flood goes on and moves nothing.
        here = ready.encoder[-1][1]
        count = len(ready.encoder)
        ready.wait(lambda: len(ready.encoder) > count + 300, 'ticks')
        assert abs(ready.encoder[-1][1] - here) < 1e-4
    ready.wait(ready.says('stage_driver: state', 'ready', 'fault'), 'the state')


def test_two_controllers_at_once_move_it_within_its_limits_and_not_after_their_end(
    ready: Watch, controller: Callable[..., Controller]
) -> None:
    one = controller('both', SPEED)
    two = controller('both', -SPEED)
    since = len(ready.encoder)
    # Said while it lasts: positions that both run on are beyond the limits after 1.5 s.
    quarrel = ready.says('stage_driver: set-points', 'more than one controller streams')
    ready.wait(quarrel, 'the word of two controllers')
    ready.wait(lambda: len(ready.encoder) > since + 1500, 'ticks of the quarrel')
    one.end()
    two.end()
    ready.wait(lambda: at_rest(ready), 'rest')
    rows = np.array(list(ready.encoder)[since:], dtype=float)
    assert np.abs(rows[:, 1]).max() < LIMIT + 1e-4
    speeds = np.diff(rows[:, 1]) / (1e-9 * np.diff(rows[:, 0]))
    # Each stream alone is at 0.1 m/s; the loop may overshoot, the limit of the axis is 0.2 m/s.
    assert np.abs(speeds).max() < 0.2
    ready.wait(ready.says('stage_driver: state', 'ready', 'fault'), 'the state')


def test_a_soft_limit_holds(ready: Watch, controller: Callable[..., Controller]) -> None:
    """In every mode: `tests/stage_driver/test_servo_backend.py`."""
    # From -30 mm at 0.19 m/s the limit comes after a second; the stream goes on beyond it.
    controller('velocity', 0.19).follow(ready, 0.1)
    ready.wait(lambda: at_rest(ready), 'rest at the limit')
    assert max(row[1] for row in list(ready.encoder)) < LIMIT + 1e-4
    assert max(row[1] for row in list(ready.tracker)) < LIMIT + 1e-4


def test_stop_answers_while_homing_and_training(stage: tuple[Nodes, Watch], ready: Watch) -> None:
    client = ready.client
    stop = client.node.create_client(Trigger, '/stage_driver/stop')
    stop.wait_for_service(PATIENCE)
    ended = threading.Event()
    outcomes: list[str] = []

    def home() -> None:
        while not ended.is_set():
            try:
                client.trigger('/stage_driver/home', PATIENCE)
            except StageError as error:
                outcomes.append(str(error))

    def train() -> None:
        while not ended.is_set():
            try:
                client.trigger('/calibrator/retrain', PATIENCE)
            except StageError as error:
                outcomes.append(str(error))

    busy = [threading.Thread(target=job) for job in (home, train)]
    for thread in busy:
        thread.start()
    durations, reactions = [], []
    try:
        for _ in range(15):
            ready.wait(ready.says('stage_driver: state', 'moving', 'ready'), 'homing')
            time.sleep(0.1)
            answered = threading.Event()
            stamp = ready.encoder[-1][0]
            begin = time.perf_counter()
            stop.call_async(Trigger.Request()).add_done_callback(lambda _, e=answered: e.set())
            assert answered.wait(PATIENCE)
            durations.append(time.perf_counter() - begin)
            reactions.append(1e-9 * (ready.encoder[-1][0] - stamp))
    finally:
        ended.set()
        for thread in busy:
            thread.join(PATIENCE)
    assert any('homing ended: stopped by request' in text for text in outcomes)
    # The wall clock of a loaded machine says little about one call; half of them must make it.
    assert np.median(durations) < 0.05 or np.median(reactions) < 0.05
    client.node.destroy_client(stop)


def suspend_in_motion(nodes: Nodes, watch: Watch) -> None:
    """Suspend the driver during a move; wait until the drive has braked by itself."""
    target = 0.14
    for _ in range(10):
        begin = watch.encoder[-1][1]
        watch.move(target, 0.0)
        try:
            watch.wait(lambda b=begin: abs(watch.encoder[-1][1] - b) > 0.004, 'motion', 10.0)
        except AssertionError:
            # A machine that stands still for long makes the drive brake: a fault, as it should.
            watch.home()
            continue
        nodes.signal('stage_driver', signal.SIGSTOP)
        count = len(watch.tracker)
        watch.wait(
            lambda c=count: (
                len(watch.tracker) > c + 500 and spread(last(watch.tracker, 100)) < 1e-5
            ),
            'rest by the drive alone',
        )
        if abs(watch.tracker[-1][1] - target) > 1e-3:
            return
        # Arrived before this process noticed: the other way.
        nodes.signal('stage_driver', signal.SIGCONT)
        target = -target
    raise AssertionError('the driver could not be suspended in motion')


def test_driver_suspended_and_killed_in_motion(stage: tuple[Nodes, Watch], ready: Watch) -> None:
    nodes, watch = stage
    suspend_in_motion(nodes, watch)
    nodes.signal('stage_driver', signal.SIGCONT)
    nodes.kill('stage_driver')
    here = watch.tracker[-1][1]
    count = len(watch.tracker)
    watch.wait(lambda: len(watch.tracker) > count + 200, 'points without a driver')
    assert abs(watch.tracker[-1][1] - here) < 1e-3
    watch.wait(watch.missed('stage_driver'), 'the driver missed')
    nodes.run('stage_driver')
    watch.wait(watch.says('stage_driver: state', 'not homed'), 'the new driver')
    here = watch.tracker[-1][1]
    watch.move(0.0, 0.0)
    watch.wait(lambda: 'not homed' in last_refusal(watch), 'refusal')
    assert abs(watch.tracker[-1][1] - here) < 1e-3
