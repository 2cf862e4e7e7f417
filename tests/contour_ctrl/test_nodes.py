"""The nodes as processes against a driver that steps a small plant in lockstep."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticArray
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from calibrator import model_file
from calibrator.models import make_model
from stage_core import topics
from stage_core.errors import StageError
from stage_core.ros.client_node import GraphClient
from stage_core.ros.node import LATCHED_QOS, SETPOINT_QOS, STATE_QOS, joint_state, stamp_of

from ..node_process import end, start
from ..patience import PATIENCE

MS = 1_000_000
RADIUS = 0.002


class LockstepDriver:
    """A driver and plant in one: velocities are followed to 90 %, position moves at once."""

    def __init__(self, client: GraphClient) -> None:
        node = client.node
        self.q = np.array([0.001, 0.0])
        self.stamp = 1_000 * MS
        self.streamed: list[tuple[float, ...]] = []
        self.moves: list[tuple[float, ...]] = []
        self.errors: list[tuple[float, float, float]] = []
        self.last = -1
        self.streaming = threading.Event()
        self.break_at: int | None = None
        self.mute_at: int | None = None
        self.clock = node.create_publisher(Clock, topics.CLOCK, 10)
        self.states = node.create_publisher(JointState, topics.JOINT_STATES, STATE_QOS)
        client.watch(JointState, topics.SETPOINT, SETPOINT_QOS, self.on_setpoint)

    def on_setpoint(self, message: JointState) -> None:
        stamp = stamp_of(message.header)
        if stamp == self.last:
            return
        self.last = stamp
        if message.velocity:
            if stamp != self.stamp:
                return
            self.streaming.set()
            self.streamed.append((*message.position, *message.velocity))
            if self.mute_at is not None and len(self.streamed) >= self.mute_at:
                return
            self.q = self.q + 0.9e-3 * np.array(message.velocity)
            self.advance()
            return
        self.moves.append(tuple(message.position))
        start, goal = self.q.copy(), np.array(message.position)
        for share in (*np.linspace(0.1, 1.0, 10), *np.ones(150)):
            self.q = start + share * (goal - start)
            self.advance()

    def advance(self) -> None:
        self.stamp += MS
        clock = Clock()
        clock.clock.sec, clock.clock.nanosec = divmod(self.stamp, 1_000_000_000)
        self.clock.publish(clock)
        q = np.round(self.q * 1e6) / 1e6
        if self.break_at is not None and len(self.streamed) == self.break_at:
            q[0] = float('nan')
        self.states.publish(joint_state(self.stamp, ('x', 'y'), q, (0.0, 0.0)))


@pytest.fixture
def driver(ros_env: dict[str, str]) -> Iterator[tuple[GraphClient, LockstepDriver]]:
    with GraphClient('fake_driver') as client:
        yield client, LockstepDriver(client)


def asked_to_run(client: GraphClient, failures: list[str]) -> threading.Thread:
    """Ask for a run that is to fail; its reason is put into `failures`."""

    def run() -> None:
        try:
            client.trigger('/contour_ctrl/run', PATIENCE)
        except StageError as error:
            failures.append(str(error))

    waiting = threading.Thread(target=run)
    waiting.start()
    return waiting


def refuses_what_it_cannot_run(client: GraphClient) -> None:
    with pytest.raises(StageError, match='curve_file'):
        client.wait_for_service('/contour_ctrl/run', PATIENCE)
        client.set_parameters('/contour_ctrl', contour='nurbs')
        client.trigger('/contour_ctrl/run', PATIENCE)
    with pytest.raises(StageError, match='cannot read the curve'):
        client.set_parameters('/contour_ctrl', curve_file='/none')
    client.set_parameters('/contour_ctrl', contour='circle')
    with pytest.raises(StageError, match='nothing to abort'):
        client.trigger('/contour_ctrl/abort', PATIENCE)


def learns_and_repeats_itself(client: GraphClient, plant: LockstepDriver, saved: Path) -> None:
    message = client.trigger('/contour_ctrl/run', PATIENCE)
    assert '2 iterations; first: tracking RMS' in message and 'best, iteration' in message
    first = list(plant.streamed)
    assert plant.moves[0] == pytest.approx((RADIUS, 0.0))
    assert plant.moves[-1] == pytest.approx((RADIUS, 0.0))
    assert len(first) % 2 == 0 and len(first) > 900
    radius = np.hypot(*np.array(first)[:, :2].T)
    assert radius == pytest.approx(RADIUS, rel=1e-9)
    (kept,) = saved.iterdir()
    taught = kept.read_bytes()

    plant.streamed.clear()
    again = client.trigger('/contour_ctrl/run', PATIENCE)
    # The plant starts at the start point now: same ticks, same set-points, same figures.
    assert again == message
    assert plant.streamed == first

    client.set_parameters('/contour_ctrl', reuse_learned=True, feed=0.029)
    with pytest.raises(StageError, match='nothing is learned yet of this contour'):
        client.trigger('/contour_ctrl/run', PATIENCE)
    # A run that learns nothing, of the same contour, leaves what was learned.
    client.set_parameters('/contour_ctrl', reuse_learned=False, feed=0.03, scheme='p_ff')
    client.trigger('/contour_ctrl/run', PATIENCE)
    client.set_parameters('/contour_ctrl', scheme='cccmac+rilc')
    assert [path.read_bytes() for path in saved.iterdir()] == [taught]


def aborts_smoothly(client: GraphClient, plant: LockstepDriver) -> None:
    plant.streamed.clear()
    plant.streaming.clear()
    failures: list[str] = []
    waiting = asked_to_run(client, failures)
    assert plant.streaming.wait(PATIENCE)
    assert client.trigger('/contour_ctrl/abort', PATIENCE) == 'stopping'
    waiting.join(PATIENCE)
    assert 'aborted by request' in failures[0]
    speed = np.hypot(*np.array(plant.streamed)[:, 2:].T)
    assert speed[-1] < 2e-3 and np.abs(np.diff(speed)).max() < 3e-3


def stops_where_the_encoder_breaks(client: GraphClient, plant: LockstepDriver) -> None:
    plant.streamed.clear()
    plant.break_at = 300
    with pytest.raises(StageError, match='encoder position is not a number'):
        client.trigger('/contour_ctrl/run', PATIENCE)
    assert len(plant.streamed) == 300
    assert plant.moves[-1] == pytest.approx(plant.streamed[-1][:2], abs=4e-3)
    plant.break_at = None


def follows_the_calibration_model(
    client: GraphClient, plant: LockstepDriver, file: Path, seen: list[str]
) -> None:
    """The stage goes where the table comes out right."""
    commands = np.random.default_rng(0).uniform(-0.01, 0.01, (200, 2))
    model = make_model('affine').fit(commands, 1.01 * commands + 1e-5)
    model_file.save(model_file.StoredModel(model), file)
    latched = client.node.create_publisher(String, topics.MODEL, LATCHED_QOS)
    client.wait_for(
        lambda: latched.get_subscription_count() > 0, PATIENCE, 'a reader of the model'
    )
    announced = {'version': 1, 'metrics': {}, 'max_correction': 1e-3}
    latched.publish(String(data=json.dumps({'active': True, 'file': str(file), **announced})))
    client.wait_for(lambda: any(file.name in text for text in seen), PATIENCE, 'the model')
    plant.streamed.clear()
    plant.moves.clear()
    client.set_parameters('/contour_ctrl', iterations=1, scheme='ccc')
    client.trigger('/contour_ctrl/run', PATIENCE)
    table = 1.01 * np.array(plant.streamed)[:, :2] + 1e-5
    assert np.hypot(*table.T) == pytest.approx(RADIUS, rel=1e-6)


def ends_where_the_encoder_falls_silent(client: GraphClient, plant: LockstepDriver) -> None:
    plant.streamed.clear()
    plant.mute_at = 250
    client.set_parameters('/contour_ctrl', lockstep_timeout=0.7)
    with pytest.raises(StageError, match='no encoder message on /stage/joint_states for'):
        client.trigger('/contour_ctrl/run', PATIENCE)
    assert len(plant.streamed) == 250
    # The move to the start is the last one: the driver stops a stream that ends.
    assert plant.moves[-1] == pytest.approx(plant.streamed[0][:2], abs=1e-6)


def serves_while_it_plans(client: GraphClient, plant: LockstepDriver, seen: list[str]) -> None:
    """Services live while a contour of 800000 ticks is planned."""
    moves = len(plant.moves)
    client.set_parameters('/contour_ctrl', feed=2.0 * np.pi * RADIUS / 800.0)
    seen.clear()
    failures: list[str] = []
    waiting = asked_to_run(client, failures)
    client.wait_for(
        lambda: any('planning the contour' in text for text in seen), PATIENCE, 'the planning'
    )
    assert client.trigger('/contour_ctrl/abort', PATIENCE) == 'stopping'
    waiting.join(PATIENCE)
    assert 'aborted by request' in failures[0]
    with pytest.raises(StageError, match='still being planned'):
        client.trigger('/contour_ctrl/run', PATIENCE)
    assert len(plant.moves) == moves


def test_contour_node_learns_repeats_itself_aborts_and_faults(
    ros_env: dict[str, str], driver: tuple[GraphClient, LockstepDriver], tmp_path: Path
) -> None:
    client, plant = driver
    process = start(
        'contour_ctrl.node',
        ros_env,
        use_sim_time=True,
        contour='circle',
        radius=RADIUS,
        feed=0.03,
        iterations=2,
        scheme='cccmac+rilc',
        session_folder=tmp_path / 'session',
        machine='fake',
    )
    seen: list[str] = []
    client.watch(DiagnosticArray, topics.DIAGNOSTICS, callback=lambda m: seen.append(str(m)))
    try:
        refuses_what_it_cannot_run(client)
        learns_and_repeats_itself(client, plant, tmp_path / 'session')
        aborts_smoothly(client, plant)
        stops_where_the_encoder_breaks(client, plant)
        follows_the_calibration_model(client, plant, tmp_path / 'model.json', seen)
        ends_where_the_encoder_falls_silent(client, plant)
        serves_while_it_plans(client, plant, seen)
    finally:
        output = end(process)
    assert process.returncode == 0, output
