"""The steps of a session, in order; each prints what it found."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from calibrator import model_file
from stage_bringup.client_node import SessionClient
from stage_bringup.graph import Options
from stage_bringup.plan import (
    alignment_points,
    calibration_grid,
    heldout_points,
    positioning_points,
)
from stage_bringup.processes import Processes
from stage_bringup.progress import Progress, State
from stage_bringup.table import Row, as_dict, heldout_rows, render
from stage_core import topics
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.quantities import MICROMETRE

#: Time that one move may take [s], in lockstep of simulated time: see `SessionClient.go_to`.
MOVE_TIMEOUT = 120.0
#: Wall time until every node is there and has compiled its kernels, on a busy machine [s].
START_TIMEOUT = 240.0
#: Wall time of a diagnosis [s]: one took 600 s on two cores at a load of 24.
DIAGNOSIS_TIMEOUT = 1800.0
#: Silence of the tracker that says that lockstep stands still and all is recorded [s].
QUIET = 0.5


@dataclass
class SessionResult:
    """What a session found; `data` goes to session.json, arrays [m] to the report."""

    rows: list[Row] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    data: dict[str, Any] = field(default_factory=dict)
    targets: Array = field(default_factory=lambda: np.zeros((0, 2)))
    before: Array = field(default_factory=lambda: np.zeros((0, 2)))
    after: Array = field(default_factory=lambda: np.zeros((0, 2)))
    bags: dict[str, Path] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """What is printed at the end."""
        return '\n'.join(['', render(self.rows), '', *self.lines])


class Session:
    """One session on a running graph."""

    def __init__(self, options: Options, processes: Processes, client: SessionClient) -> None:
        self.options = options
        self.processes = processes
        self.client = client
        self.centre = np.zeros(2)
        self.half_range = 0.04
        self.result = SessionResult()
        self._progress = Progress()

    @contextmanager
    def step(self, text: str, watch: Callable[[], State] | None = None) -> Iterator[None]:
        """Announce a step and show its progress until it ends."""
        self.processes.check()
        steps = self.result.data.setdefault('steps', [])
        steps.append(f'[{len(steps) + 1:2d}] {text}')
        print(steps[-1], flush=True)
        with Progress(watch) as self._progress:
            yield

    def show(self, fraction: float | None, text: str) -> None:
        """Say how far the step is."""
        self._progress.show(fraction, text)

    def visit(self, points: Iterable[Array], measure: bool) -> Array:
        """Rest at each point (n, 2) [m]; the measured table points (n, 2) [m] if asked."""
        wanted, measured = list(points), []
        for number, point in enumerate(wanted):
            self.show(number / len(wanted), f'{number} of {len(wanted)} positions')
            at = self.client.go_to(self.centre + point, MOVE_TIMEOUT, self.processes.check)
            if measure:
                raw = self.client.measure(at, 0.4 * self.client.settle_time, MOVE_TIMEOUT)
                measured.append(self.client.alignment().apply(raw)[:2])
        return np.array(measured)

    def quiet(self) -> None:
        """Wait until everything that was measured has arrived (lockstep only)."""
        if self.options.clock == 'lockstep':
            self.client.wait_until_quiet(topics.TRACKER_POINT, QUIET, MOVE_TIMEOUT)

    def record(self, name: str) -> Path:
        """Start recording; the folder of the bag."""
        self.client.set_parameters('/session_recorder', name=name)
        path = Path(self.client.trigger('/session_recorder/start', 30.0))
        self.result.bags[name] = path
        return path

    def stop_recording(self) -> None:
        """Stop recording once everything has arrived."""
        self.quiet()
        self.client.trigger('/session_recorder/stop', 60.0)


def run_steps(options: Options, processes: Processes) -> SessionResult:
    """Run every step on a graph that is starting up.

    Raises
    ------
    StageError
        Of the step that failed, with its reason.
    """
    with SessionClient(0.6, options.clock == 'lockstep', options.backend == 'zaber') as client:
        session = Session(options, processes, client)
        _start(session)
        _align(session)
        if options.standard_tests:
            _test_positioning(session)
        _calibrate(session)
        _circle(session)
        _retrain_offline(session)
        if options.diagnose:
            _diagnose(session)
        _stop(session)
    session.result.data['rows'] = as_dict(session.result.rows)
    return session.result


def _start(session: Session) -> None:
    client, check = session.client, session.processes.check
    with session.step('starting the graph; homing'):
        for service in (
            '/stage_driver/home',
            '/tracker_bridge/align',
            '/session_recorder/start',
            '/calibrator/retrain',
            '/contour_ctrl/run',
        ):
            session.show(None, f'waiting for {service}')
            client.wait_for_service(service, START_TIMEOUT, check)
        client.set_bool('/stage_driver/enable', True, 60.0)
        # A tracker that is met later would miss the first positions.
        session.show(None, 'waiting for the plant and its tracker')
        client.wait_for(lambda: client.connected, START_TIMEOUT, 'a tracker at the bridge')
        session.show(None, 'homing')
        client.trigger('/stage_driver/home', MOVE_TIMEOUT)
        count = client.node.count_subscribers
        client.wait_for(lambda: count(topics.TARGET) > 0, 30.0, f'a reader of {topics.TARGET}')
    low = [client.parameter('/stage_driver', f'{axis}.limit_lower') for axis in 'xy']
    high = [client.parameter('/stage_driver', f'{axis}.limit_upper') for axis in 'xy']
    session.centre = 0.5 * (np.array(low) + np.array(high))
    session.half_range = min(0.04, 0.4 * float(np.min(np.array(high) - np.array(low))))
    client.settle_time = float(client.parameter('/stage_driver', 'settle_time'))


def _align(session: Session) -> None:
    with session.step('aligning the tracker with the stage (eq. 24 of paper 1)'):
        session.client.trigger('/tracker_bridge/reset')
        session.visit(alignment_points(session.half_range), measure=False)
        session.quiet()
        message = session.client.trigger('/tracker_bridge/align', 60.0)
        # Latched, but on its way: without it every position would be off by the tracker's frame.
        session.client.wait_for(
            lambda: session.client.latest(topics.ALIGNMENT) is not None, 60.0, topics.ALIGNMENT
        )
    session.result.lines.append(f'alignment: {message}')


def _calibrate(session: Session) -> None:
    options, client, result = session.options, session.client, session.result
    grid = calibration_grid(session.half_range, options.grid)
    with session.step(f'recording the calibration session: {len(grid)} positions'):
        bag = session.record('calibration')
        session.visit(grid, measure=False)
        session.stop_recording()
    heldout = heldout_points(session.half_range, options.heldout, options.seed)
    with session.step(f'measuring {len(heldout)} held-out points before the correction'):
        before = session.visit(heldout, measure=True)

    def training() -> State:
        # An iteration and its error while a method iterates, 'no' or 'None' else.
        told = client.status('calibrator: model')[1].get('training', '')
        return None, f'iteration, error: {told}' if told.startswith('(') else 'training'

    with session.step(f'retraining the calibrator ({options.method}) from {bag.name}', training):
        client.set_parameters('/calibrator', bag=str(bag))
        message = client.trigger('/calibrator/retrain', 600.0)
        client.set_bool('/calibrator/activate', True)
    result.lines.append(f'calibrator: {message}')
    with session.step(f'measuring {len(heldout)} held-out points after the correction'):
        after = session.visit(heldout, measure=True)
    result.targets = heldout + session.centre
    result.before, result.after = before - result.targets, after - result.targets
    result.rows += heldout_rows(result.before, result.after)
    result.data['heldout'] = {
        'targets': result.targets.tolist(),
        'errors_before': result.before.tolist(),
        'errors_after': result.after.tolist(),
    }


def _test_positioning(session: Session) -> None:
    with session.step('testing the positioning of both axes by ISO 230-2'):
        session.record('positioning')
        for axis in range(2):
            session.visit(positioning_points(session.half_range, axis), measure=False)
        session.stop_recording()


def _circle(session: Session) -> None:
    client, count = session.client, session.options.iterations
    session.record('circle')
    # ISO 230-4 asks for both ways. The last one leaves what was learned.
    for words, clockwise, times in (
        ('once clockwise', True, 1),
        (f'{count} times' if count > 1 else 'once', False, count),
    ):
        with session.step(f'following the circle {words}', lambda: contour_state(client)):
            client.set_parameters('/contour_ctrl', clockwise=clockwise, iterations=times)
            message = client.trigger('/contour_ctrl/run', 900.0)
            # The next run begins at the same tick in every session: from a world that stands.
            session.quiet()
    session.stop_recording()
    session.result.lines.append(f'circle: {message}')


def contour_state(client: SessionClient) -> State:
    """How far the contour controller is, from what it says on /diagnostics."""
    sentence, values = client.status('contour_ctrl: contour')
    counted = re.match(r'iteration (\d+) of (\d+)', sentence)
    ticks = re.match(r'(\d+) of (\d+)', values.get('tick', ''))
    if not counted or not ticks:
        return None, sentence
    iteration, iterations = (int(word) for word in counted.groups())
    tick, length = (int(word) for word in ticks.groups())
    return (iteration - 1 + min(tick / length, 1.0)) / iterations, sentence


def _retrain_offline(session: Session) -> None:
    # The command that a user would run, with nothing but the bag.
    client, options = session.client, session.options
    offline_file = options.out / 'models' / 'offline.json'
    with session.step('retraining offline from the bag alone'):
        session.show(None, 'ros2 run calibrator retrain_offline')
        done = subprocess.run(
            [sys.executable, '-m', 'calibrator.retrain_offline']
            + ['--bag', str(session.result.bags['calibration'])]
            + ['--method', options.method, '--out', str(offline_file)],
            capture_output=True,
            text=True,
        )
    if done.returncode != 0:
        raise StageError(f'offline retraining failed: {done.stderr.strip()}')
    client.wait_for(lambda: client.latest(topics.MODEL) is not None, 30.0, topics.MODEL)
    announced: Any = client.latest(topics.MODEL)
    online = model_file.load(Path(json.loads(announced.data)['file'])).model
    offline = model_file.load(offline_file).model
    points = session.result.targets
    difference = max(
        float(np.abs(online.predict(points, side) - offline.predict(points, side)).max())
        for side in (np.ones_like(points), -np.ones_like(points))
    )
    session.result.lines.append(
        f'offline retraining: predictions differ from those of the online model by at most '
        f'{difference / MICROMETRE:.3f} µm'
    )
    session.result.data['offline_difference'] = difference


def _diagnose(session: Session) -> None:
    client, bags = session.client, session.result.bags
    with session.step(
        'diagnosing the gap between the nominal twin and this session',
        lambda: (None, client.status('gap_diagnosis: diagnosis')[0]),
    ):
        client.set_parameters('/gap_diagnosis', bag=str(bags['calibration']))
        verdict = client.trigger('/gap_diagnosis/diagnose', DIAGNOSIS_TIMEOUT)
    session.result.lines.append(f'diagnosis: {verdict}')


def _stop(session: Session) -> None:
    with session.step('shutting down'):
        session.client.trigger('/stage_driver/stop', 30.0)
        session.client.set_bool('/stage_driver/enable', False)
