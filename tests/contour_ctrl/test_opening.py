"""A run's first set-point reaches a driver that joins after the recorder has."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy')

from sensor_msgs.msg import JointState

from contour_ctrl.phases import SetPoint
from stage_core import topics
from stage_core.ros.client_node import GraphClient
from stage_core.ros.node import SETPOINT_QOS, STATE_QOS

from .test_fresh_encoder import AskedRun, controller

OPENING = SetPoint(1_000_000_000, (0.01, 0.02))


class OpenedRun(AskedRun):
    """In place of a run: opens with a move."""

    def begin(self, stamp: int) -> SetPoint:
        return OPENING


def test_a_driver_that_joins_late_hears_the_opening_move(ros_env: dict[str, str]) -> None:
    recorded: list[JointState] = []
    heard: list[JointState] = []
    with (
        GraphClient('others', use_sim_time=False) as client,
        controller(client) as (node, until),
    ):
        client.node.create_subscription(JointState, topics.SETPOINT, recorded.append, SETPOINT_QOS)
        until(lambda: node._setpoints.get_subscription_count() == 1, 'the recorder')
        node.begin(OpenedRun())  # type: ignore[arg-type]
        with GraphClient('stage', use_sim_time=False) as stage:
            stage.node.create_publisher(JointState, topics.JOINT_STATES, STATE_QOS)
            stage.node.create_subscription(JointState, topics.SETPOINT, heard.append, SETPOINT_QOS)
            until(lambda: heard, 'the opening at the stage')
        until(lambda: recorded, 'the opening in the record')
        assert [list(point.position) for point in heard] == [[0.01, 0.02]]
        assert len(recorded) == 1
