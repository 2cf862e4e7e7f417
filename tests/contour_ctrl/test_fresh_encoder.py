"""A controller that was held up in real time answers what is fresh, and leaves out the past."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

pytest.importorskip('rclpy')

from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState

from contour_ctrl.contour_parameters import PARAMETERS
from contour_ctrl.phases import SetPoint
from contour_ctrl.streaming_node import StreamingNode
from stage_core import topics
from stage_core.ros.client_node import GraphClient
from stage_core.ros.node import SETPOINT_QOS, STATE_QOS, joint_state

from ..patience import PATIENCE

MS = 1_000_000
START = 1_000 * MS
#: At the default speed limit a set-point for an older tick is 1 mm behind, see `FRESH_QOS`.
FRESH = 5 * MS


class AskedRun:
    """In place of a run: keeps the stamps [ns] that it is asked to answer."""

    done = waits_for_quiet = False

    def __init__(self) -> None:
        self.stamps: list[int] = []

    def begin(self, stamp: int) -> SetPoint | None:
        """Nothing to publish."""

    def on_state(self, stamp: int, qx: float, qy: float) -> None:
        self.stamps.append(stamp)


class Patient(StreamingNode):
    """Does not end a run because the test is slow."""

    def silence_limit(self) -> float:
        return math.inf


@contextmanager
def controller(client: GraphClient) -> Iterator[tuple[Patient, Callable[..., None]]]:
    """A controller, and a wait for a condition in which its executor and the client go on."""
    node, executor = Patient('controller', PARAMETERS), SingleThreadedExecutor()
    executor.add_node(node)

    def until(condition: Callable[[], object], what: str) -> None:
        def goes_on() -> bool:
            executor.spin_once(0.01)
            return bool(condition())

        client.wait_for(goes_on, PATIENCE, what)

    try:
        yield node, until
    finally:
        executor.shutdown()
        node.destroy_node()


def test_a_controller_that_was_held_up_answers_the_newest_ticks(ros_env: dict[str, str]) -> None:
    with (
        GraphClient('encoder', use_sim_time=False) as client,
        controller(client) as (node, until),
    ):
        run = AskedRun()
        states = client.node.create_publisher(JointState, topics.JOINT_STATES, STATE_QOS)
        client.watch(JointState, topics.SETPOINT, SETPOINT_QOS)

        def publish(stamp: int) -> None:
            states.publish(joint_state(stamp, ('x', 'y'), (0.0, 0.0), (0.0, 0.0)))

        node.begin(run)  # type: ignore[arg-type]
        until(lambda: node._begun and states.get_subscription_count() > 0, 'the run')
        publish(START)
        until(lambda: run.stamps, 'an answer')
        # Held up: sixty ticks come, and none is looked at.
        newest = START + 60 * MS
        for stamp in range(START + MS, newest + MS, MS):
            publish(stamp)
        assert states.wait_for_all_acked(Duration(seconds=PATIENCE))
        until(lambda: run.stamps[-1] == newest, 'the newest')
        late = [stamp for stamp in run.stamps[1:] if stamp <= newest - FRESH]
        assert late == []
