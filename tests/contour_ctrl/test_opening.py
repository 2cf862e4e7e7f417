"""A run's first set-point reaches a driver that joins after the recorder has."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy')

from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState

from contour_ctrl.contour_parameters import PARAMETERS
from contour_ctrl.phases import SetPoint
from stage_core import topics
from stage_core.ros.client_node import GraphClient
from stage_core.ros.node import SETPOINT_QOS

from .test_fresh_encoder import AskedRun, Patient, waiting

OPENING = SetPoint(1_000_000_000, (0.01, 0.02))


class OpenedRun(AskedRun):
    """In place of a run: opens with a move."""

    def begin(self, stamp: int) -> SetPoint:
        return OPENING


def test_a_driver_that_joins_late_hears_the_opening_move(ros_env: dict[str, str]) -> None:
    with GraphClient('others', use_sim_time=False) as client:
        node = Patient('controller', PARAMETERS)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        recorded: list[JointState] = []
        heard: list[JointState] = []

        def listen(kept: list[JointState]) -> None:
            client.node.create_subscription(JointState, topics.SETPOINT, kept.append, SETPOINT_QOS)

        until = waiting(client, executor)
        try:
            listen(recorded)
            node.begin(OpenedRun())  # type: ignore[arg-type]
            until(lambda: recorded, 'the opening in the record')
            listen(heard)
            until(lambda: heard, 'the opening at the driver')
            assert list(heard[0].position) == [0.01, 0.02]
        finally:
            executor.shutdown()
            node.destroy_node()
