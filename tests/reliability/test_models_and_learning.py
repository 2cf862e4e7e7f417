"""What the calibrator refuses while it runs, and what learning cannot do to the stage."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from std_srvs.srv import Trigger

from calibrator import model_file
from calibrator.correction import Correction
from calibrator.model_file import StoredModel
from calibrator.models import make_model
from calibrator.online import OnlineAdapter
from contour_ctrl.curves import circle
from contour_ctrl.learning import Learner, LearningSettings
from contour_ctrl.reference import plan
from contour_ctrl.sequence import REST_TIME, ContourRun
from contour_ctrl.tick import Controller, Gains
from session_bags.writer import write_session
from stage_core import topics
from stage_core.errors import StageError
from stage_core.ros.node import joint_state
from stage_driver.limits import AxisLimits, check_setpoint
from stage_driver.motion import MotionGenerator

from ..calibrator.conftest import make_grid_session
from ..patience import PATIENCE
from .rig import Nodes, Watch

MAX_CORRECTION = 1e-3
LIMITS = (AxisLimits(-0.15, 0.15, 0.2, 2.0, 4.0),) * 2
MS = 1_000_000


def affine(scale: float, machine: str = 'bench') -> StoredModel:
    """A model of a stage with a scale error."""
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (100, 2))
    model = make_model('affine').fit(points, (1.0 + scale) * points)
    return StoredModel(model, machine)


@pytest.fixture(scope='module')
def calibrator(graph: Callable[..., Any]) -> Iterator[tuple[Nodes, Watch]]:
    """The calibrator alone, of the machine `bench`."""
    with graph('calibrator', clock='realtime', calibrator={'machine': 'bench'}) as (nodes, watch):
        watch.wait(lambda: watch.client.latest(topics.MODEL) is not None, 'the calibrator')
        watch.client.wait_for(
            lambda: (
                watch.targets.get_subscription_count() > 0
                and watch.client.node.count_publishers(topics.SETPOINT) > 1
            ),
            PATIENCE,
            'discovery',
        )
        yield nodes, watch


def corrected(watch: Watch, target: float) -> float:
    """Set-point that the calibrator makes of a target on x."""
    watch.client.latest(topics.SETPOINT)
    stamp = int(1e9 * (1000.0 + corrected.calls))  # type: ignore[attr-defined]
    corrected.calls += 1  # type: ignore[attr-defined]
    watch.targets.publish(joint_state(stamp, ('x', 'y'), position=(target, 0.0)))

    def came() -> bool:
        message = watch.client.latest(topics.SETPOINT)
        return message is not None and message.header.stamp.sec == stamp // 10**9

    watch.wait(came, 'the set-point')
    return float(watch.client.latest(topics.SETPOINT).position[0])


corrected.calls = 0  # type: ignore[attr-defined]


def use(client: Any, path: Path, scale: float) -> None:
    """Let the calibrator correct by a new model."""
    model_file.save(affine(scale), path)
    client.set_parameters('/calibrator', model_file=str(path))
    client.trigger('/calibrator/load', PATIENCE)
    client.set_bool('/calibrator/activate', True)


def test_bad_model_files_leave_the_old_model(
    calibrator: tuple[Nodes, Watch], tmp_path: Path
) -> None:
    """What a file can be refused for is in `tests/calibrator/test_model_file.py`."""
    nodes, watch = calibrator
    client = watch.client
    use(client, tmp_path / 'good.json', 1e-3)
    before = corrected(watch, 0.1)
    assert before == pytest.approx(0.1 / 1.001, abs=1e-9)
    other, pickled, witness = (tmp_path / name for name in ('other', 'pickled', 'executed'))
    model_file.save(affine(5e-3, 'lathe'), other)
    # Loading this with pickle would make the file `executed`.
    pickled.write_bytes(f'cbuiltins\nopen\n(V{witness}\nVw\ntR.'.encode())
    for path, words in ((other, 'trained on machine lathe'), (pickled, 'not valid JSON')):
        client.set_parameters('/calibrator', model_file=str(path))
        with pytest.raises(StageError, match=words):
            client.trigger('/calibrator/load', PATIENCE)
        assert corrected(watch, 0.1) == before
    assert not witness.exists()
    assert nodes.dead() == []


def test_an_aborted_training_leaves_the_old_model(
    calibrator: tuple[Nodes, Watch], tmp_path: Path
) -> None:
    nodes, watch = calibrator
    client = watch.client
    use(client, tmp_path / 'good.json', 2e-3)
    before = corrected(watch, 0.1)
    bag = write_session(tmp_path / 'bag', make_grid_session(30))
    # A training that would take for ever, ended in the middle.
    client.set_parameters(
        '/calibrator',
        bag=str(bag),
        method='it2fls',
        options='{"particles": 200, "iterations": 100000}',
    )
    service = client.node.create_client(Trigger, '/calibrator/retrain')
    answer = service.call_async(Trigger.Request())
    client.wait_for(lambda: _aborted(client), PATIENCE, 'the abort')
    client.wait_for(answer.done, PATIENCE, 'the answer')
    assert not answer.result().success and 'aborted' in answer.result().message
    assert corrected(watch, 0.1) == before
    assert nodes.dead() == []


def _aborted(client: Any) -> bool:
    try:
        return 'aborted' in client.trigger('/calibrator/abort', PATIENCE)
    except StageError:
        return False


WILD = st.one_of(
    st.floats(-1e6, 1e6), st.sampled_from([1e300, -1e300, float('nan'), float('inf'), 0.0])
)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.tuples(WILD, WILD), min_size=30, max_size=60), st.integers(0, 2**31))
def test_absurd_measurements_cannot_drive_the_stage_beyond_its_limits(
    measured: list[tuple[float, float]], seed: int
) -> None:
    stored = affine(1e-3)
    adapter = OnlineAdapter(stored.model, deviation=1e-3, noise=1e-6, forgetting=0.95)
    correction = Correction(MAX_CORRECTION)
    correction.stored = stored
    correction.activate(True)
    generator = np.random.default_rng(seed)
    executed = 0
    with np.errstate(all='ignore'):
        for point in measured:
            command = generator.uniform(-0.15, 0.15, (1, 2))
            with contextlib.suppress(StageError):
                adapter.update(command, np.array([point]))
            correction.stored = StoredModel(adapter.model, 'bench')
            target = generator.uniform(-0.15, 0.15, 2)
            try:
                wanted = correction.apply(target)
                setpoint = check_setpoint('xy', LIMITS, 0, ('x', 'y'), wanted, ())
            except StageError:
                continue
            executed += 1
            assert np.abs(wanted - target).max() <= MAX_CORRECTION
            assert all(-0.15 <= (p or 0.0) <= 0.15 for p in setpoint.positions)
    assert executed <= len(measured)


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([1e-3, 1.0, 1e3]))
def test_absurd_learning_stays_within_the_drivers_limits(seed: int, amplitude: float) -> None:
    """The encoder lies wildly for two iterations: what the driver executes keeps its limits."""
    generator = np.random.default_rng(seed)
    reference = plan(circle(0.005, (0.1, 0.0)), 0.03)
    learner = Learner(
        len(reference), 1e-3, LearningSettings(gain=(1e4, 1e4), divergence=0.0, cutoff=100.0)
    )
    gains = Gains((40.0, 40.0), (0.9, 0.8))
    run = ContourRun(Controller(reference, gains), learner, 2)
    motion = MotionGenerator(LIMITS, np.tile([40.0, 0, 0, 0, 0, 0], (2, 1)), 1e-3, 100.0, 0.1)
    encoder = np.array(reference.position[0], dtype=float)
    motion.hold(encoder)
    run.begin(0)
    fastest = 0.0
    begins = round(1e3 * REST_TIME) + 100
    for tick in range(begins + 5 * len(reference) // 2):
        # At rest where it should be until the contour begins, then nonsense.
        shown = encoder + (tick > begins) * generator.uniform(-amplitude, amplitude, 2)
        point = run.on_state(tick * MS, *shown)
        if point is not None and point.position is not None:
            try:
                motion.take(
                    check_setpoint(
                        'xy', LIMITS, point.stamp, 'xy', point.position, point.velocity or ()
                    ),
                    encoder,
                )
            except StageError:
                if motion.streaming:
                    motion.stop(encoder)
        motion.tick(encoder)
        if motion.follows_reference:
            motion.command[:] = 40.0 * (motion.reference - encoder)
        # An ideal velocity loop: the stage goes as fast as it is told.
        encoder = encoder + 1e-3 * motion.command
        fastest = max(fastest, float(np.abs(motion.command).max()))
        assert np.abs(encoder).max() <= 0.15 + 1e-4
    assert fastest <= 0.2 * 1.01
    assert learner.factors, 'nothing was learned from the lies'
