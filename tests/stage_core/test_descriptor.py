"""The range that ROS shows for a parameter."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from stage_core.parameters import Parameter
from stage_core.ros.descriptor_node import descriptor


def test_an_open_end_of_a_range_is_as_far_as_ros_can_say() -> None:
    (count,) = descriptor(Parameter('count', 3, 'laps', '1', minimum=1)).integer_range
    assert (count.from_value, count.to_value, count.step) == (1, 2**62, 1)
    (feed,) = descriptor(Parameter('feed', 1.0, 'feed', 'm/s', maximum=2.0)).floating_point_range
    assert (feed.from_value, feed.to_value, feed.step) == (-1e308, 2.0, 0.0)
    free = descriptor(Parameter('name', 'a', 'one of two', choices=('a', 'b')))
    assert not free.integer_range and free.additional_constraints == 'one of a, b'
