"""A run's first set-point reaches a driver that joins after the recorder has."""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytest.importorskip('rclpy')

from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState

from contour_ctrl.contour_parameters import PARAMETERS
from contour_ctrl.phases import SetPoint
from stage_core import topics
from stage_core.ros.client_node import GraphClient
from stage_core.ros.node import SETPOINT_QOS, STATE_QOS, joint_state

from ..patience import PATIENCE
from .test_fresh_encoder import AskedRun, Patient

OPENING = SetPoint(1_000_000_000, (0.01, 0.02))


class OpenedRun(AskedRun):
    """In place of a run: opens with a move."""

    def begin(self, stamp: int) -> SetPoint:
        return OPENING


def test_a_driver_that_joins_late_hears_the_opening_move(ros_env: dict[str, str]) -> None:
    with GraphClient('others', use_sim_time=False) as client:
        node, run = Patient('controller', PARAMETERS), OpenedRun()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        states = client.node.create_publisher(JointState, topics.JOINT_STATES, STATE_QOS)
        recorded: list[JointState] = []
        heard: list[JointState] = []

        def listen(kept: list[JointState]) -> None:
            client.node.create_subscription(JointState, topics.SETPOINT, kept.append, SETPOINT_QOS)

        def until(condition: Callable[[], object], what: str) -> None:
            def goes_on() -> bool:
                executor.spin_once(0.01)
                return bool(condition())

            client.wait_for(goes_on, PATIENCE, what)

        try:
            listen(recorded)
            node.begin(run)  # type: ignore[arg-type]
            until(lambda: recorded, 'the opening in the record')
            listen(heard)
            until(lambda: heard, 'the opening at the driver')
            assert list(heard[0].position) == [0.01, 0.02]
            # Once the stage answers, it is not said again.
            publish = joint_state(OPENING.stamp, ('x', 'y'), (0.0, 0.0), (0.0, 0.0))
            until(lambda: states.get_subscription_count() > 0, 'the controller')
            states.publish(publish)
            until(lambda: run.stamps, 'an answer')
            executor.spin_once(0.01)
            count = len(recorded)
            for _ in range(20):
                executor.spin_once(0.01)
            assert len(recorded) <= count + 1
        finally:
            executor.shutdown()
            node.destroy_node()
