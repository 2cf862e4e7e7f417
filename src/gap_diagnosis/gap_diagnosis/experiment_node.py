"""Runs the experiment of a report on the stage: contour controller, recorder, and their order."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python

from gap_diagnosis.experiment.travel import FILE, travel_of
from stage_core import topics
from stage_core.errors import StageError
from stage_core.ros.client_node import GraphClient
from stage_core.twin_file import TwinFile

CONTROLLER, RECORDER, DRIVER = '/contour_ctrl', '/session_recorder', 'stage_driver: state'
#: Wall time [s]: of a service that answers at once, to hear of the driver, of a run in lockstep
#: on a busy machine per second of motion, and beyond that.
ANSWER, HEARD, SLOWNESS, PATIENCE = 30.0, 10.0, 20.0, 120.0
#: Silence of the tracker that says that all is recorded in lockstep; without it the same wait [s].
QUIET = 0.5
#: Of the positions in the table of a motion [m].
ROUNDING = 1e-9
READY = 'ready'


def check_report(out: Path, bag: str, twin: str) -> dict[str, Any]:
    """The last report, which has an experiment.

    Raises
    ------
    StageError
        If there is none, or it is of another bag or twin.
    """
    path = out / 'report.json'
    if not path.is_file():
        raise StageError(f'there is no report in {out}: call ~/diagnose first')
    report: dict[str, Any] = json.loads(path.read_text(encoding='utf-8'))
    sessions = report.get('session', '')
    if report.get('twin') != twin or not (sessions == bag or sessions.startswith(f'{bag}, ')):
        raise StageError(f'the report in {out} is of another bag or twin: call ~/diagnose first')
    if 'experiment' not in report or not (out / FILE).is_file():
        raise StageError('the last report leaves nothing open that a motion would decide')
    return report


def check_motion(path: Path, travel: Mapping[str, tuple[float, float]]) -> None:
    """Refuse a motion that the contour controller cannot run, or that leaves the travel [m].

    Raises
    ------
    StageError
        If it is of one axis alone, or leaves what the parameter `travel` allows.
    """
    with path.open(encoding='utf-8') as file:
        _, *axes = file.readline().strip().split(',')
        rows = np.loadtxt(file, delimiter=',', ndmin=2)
    if axes != ['x', 'y']:
        raise StageError(
            f'{path} moves {", ".join(axes)} alone, and the contour controller both axes: run it '
            'with a controller of your own'
        )
    for axis, column in zip(axes, rows.T[1:], strict=True):
        low, high = travel.get(axis, (-math.inf, math.inf))
        if column.min() < low - ROUNDING or column.max() > high + ROUNDING:
            raise StageError(
                f'the motion takes {axis} from {column.min():g} to {column.max():g} m, beyond '
                f'the travel: call ~/diagnose, which plans within {low:g} to {high:g} m'
            )


def refusal(state: dict[str, str] | None) -> str | None:
    """Why the stage must not move now, from what its driver says of itself; None if it may."""
    if state is None:
        return 'nothing is heard of stage_driver: is it running?'
    if state.get('homed') != 'True':
        return 'the stage is not homed: call /stage_driver/home first'
    if state.get('state') != READY:
        return f'the stage is {state.get("state")}, not idle: wait for its rest or stop it'
    return None


def record_experiment(out: Path, twin: str, report: dict[str, Any], lockstep: bool) -> Path:
    """Have the contour controller run the experiment; the folder of the new bag.

    Raises
    ------
    StageError
        If the stage must not move, refuses the motion, or is stopped.
    """
    states: list[dict[str, str]] = []

    def heard(message: DiagnosticArray) -> None:
        states.extend(
            {pair.key: pair.value for pair in s.values} for s in message.status if s.name == DRIVER
        )

    with GraphClient('gap_experiment', use_sim_time=lockstep) as client:
        client.watch(DiagnosticArray, topics.DIAGNOSTICS, 10, heard)
        client.watch(PointStamped, topics.TRACKER_POINT)
        deadline = time.monotonic() + HEARD
        while not states and time.monotonic() < deadline:
            time.sleep(0.05)
        wrong = refusal(states[-1] if states else None)
        if wrong:
            raise StageError(wrong)
        # The table names no path of a machine: the absolute one is for the other process.
        motion = (out / FILE).resolve()
        length = float(report['experiment']['duration'])
        with (
            _set_for_a_run(client, CONTROLLER, _settings(motion, twin)),
            _set_for_a_run(client, RECORDER, {'name': 'experiment'}),
            _recording(client, lockstep) as bag,
        ):
            client.trigger(f'{CONTROLLER}/run', SLOWNESS * length + PATIENCE)
    return bag[0]


def _settings(motion: Path, twin: str) -> dict[str, Any]:
    """Parameters of the contour controller: the plain loop of the twin, nothing learned."""
    found: dict[str, Any] = {
        'contour': 'timed',
        'curve_file': str(motion),
        'scheme': 'p_ff',
        'iterations': 1,
        'reuse_learned': False,
    }
    machine = TwinFile.load(twin)
    for axis in machine.axes:
        own = machine.servo(axis)
        found[f'{axis}.position_gain'] = own.position_gain
        found[f'{axis}.velocity_feedforward'] = own.velocity_feedforward
        found[f'{axis}.acceleration_feedforward'] = 0.0
        found[f'{axis}.coulomb'] = 0.0
    return found


@contextmanager
def _set_for_a_run(client: GraphClient, node: str, wanted: dict[str, Any]) -> Iterator[None]:
    """Parameters of a node as wanted, and as they were afterwards."""
    request = GetParameters.Request(names=list(wanted))
    answer = client.call(GetParameters, f'{node}/get_parameters', request, ANSWER)
    before = [parameter_value_to_python(value) for value in answer.values]
    try:
        client.set_parameters(node, **_named(wanted))
        yield
    finally:
        client.set_parameters(node, **_named(dict(zip(wanted, before, strict=True))))


def _named(values: dict[str, Any]) -> dict[str, Any]:
    return {name.replace('.', '__'): value for name, value in values.items()}


@contextmanager
def _recording(client: GraphClient, lockstep: bool) -> Iterator[list[Path]]:
    """A new bag while the stage moves."""
    bag = [Path(client.trigger(f'{RECORDER}/start', ANSWER))]
    try:
        yield bag
        if lockstep:
            client.wait_until_quiet(topics.TRACKER_POINT, QUIET, PATIENCE)
        else:
            time.sleep(QUIET)
    finally:
        client.trigger(f'{RECORDER}/stop', 2.0 * ANSWER)


def run_experiment(
    values: Callable[[str], Any],
    lockstep: bool,
    diagnose: Callable[[list[str]], str],
) -> str:
    """Run the experiment of the last report and diagnose again; what it decided, in a line.

    `diagnose` of bags gives the verdict line.

    Raises
    ------
    StageError
        Why nothing was moved, or why it ended early.
    """
    if not values('allow_motion'):
        raise StageError('nothing moves: set the parameter allow_motion to true first')
    if not values('bag') or not values('twin'):
        raise StageError('set the parameters bag and twin first')
    out = Path(values('out'))
    report = check_report(out, values('bag'), values('twin'))
    check_motion(out / FILE, travel_of(values('travel').split()))
    asked = ', '.join(report['experiment']['separates'])
    before = ', '.join(report['verdict']) or 'nothing'
    bag = record_experiment(out, values('twin'), report, lockstep)
    line = diagnose([values('bag'), str(bag)])
    after = json.loads((out / 'report.json').read_text(encoding='utf-8'))
    rivals = sorted({a for c in after['causes'] for a in c['alternatives']})
    left = f'; not told from {", ".join(rivals)}' if rivals else ''
    return f'asked: {asked}; before: {before}; with {bag}: {line}{left}'
