"""JointStates as bytes: what ROS itself writes and reads is the reference."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from stage_core.ros.joint_state_wire import JointStateLayout
from stage_core.ros.node import JointStateReader, joint_state, stamp_of

STAMP = 1_800_000_000_123_456_789
SHAPES = [
    (('x', 'y'), (2, 2, 0)),
    (('x', 'y'), (2, 0, 0)),
    (('x', 'y'), (0, 2, 2)),
    (('x',), (1, 1, 1)),
    (('left', 'a longer name', 'z'), (3, 3, 3)),
]


def arrays(counts: tuple[int, ...]) -> list[list[float]]:
    rng = np.random.default_rng(sum(counts))
    return [rng.standard_normal(count).tolist() for count in counts]


@pytest.mark.parametrize(('axes', 'counts'), SHAPES)
def test_ros_reads_what_is_encoded(axes: tuple[str, ...], counts: tuple[int, ...]) -> None:
    values = arrays(counts)
    data = JointStateLayout('stage', axes, counts).encode(STAMP, *values)
    message = deserialize_message(data, JointState)
    assert stamp_of(message.header) == STAMP
    assert message.header.frame_id == 'stage'
    assert message.name == list(axes)
    assert [list(message.position), list(message.velocity), list(message.effort)] == values


@pytest.mark.parametrize(('axes', 'counts'), SHAPES)
def test_a_reader_takes_what_ros_and_what_the_project_wrote(
    axes: tuple[str, ...], counts: tuple[int, ...]
) -> None:
    position, velocity, effort = values = arrays(counts)
    ours = JointStateLayout('stage', axes, counts).encode(STAMP, *values)
    theirs = serialize_message(joint_state(STAMP, axes, position, velocity, effort))
    reader = JointStateReader()
    # Twice: the second time of each the layout is known, where padding is zero.
    for data in (theirs, ours, ours, theirs):
        sample = reader.read(data)
        assert sample is not None
        assert sample.stamp == STAMP
        assert list(sample.names) == list(axes)
        assert list(sample.position) == position
        assert list(sample.velocity) == velocity


def test_another_layout_of_the_same_size_is_not_mistaken() -> None:
    values = [[1.0, 2.0], [3.0, 4.0], []]
    layout = JointStateLayout('stage', ('x', 'y'), (2, 2, 0))
    for frame, axes, counts in (
        ('stage', ('y', 'x'), (2, 2, 0)),
        ('STAGE', ('x', 'y'), (2, 2, 0)),
        ('stage', ('x', 'y'), (2, 0, 2)),
    ):
        numbers = [v for v in values if v]
        other = JointStateLayout(frame, axes, counts)
        data = other.encode(STAMP, *(numbers.pop(0) if count else [] for count in counts))
        assert layout.decode(data) is None
        assert other.decode(data) is not None
    reader = JointStateReader()
    for axes in (('x', 'y'), ('y', 'x')):
        data = JointStateLayout('stage', axes, (2, 2, 0)).encode(STAMP, *values)
        sample = reader.read(data)
        assert sample is not None and list(sample.names) == list(axes)


def test_rubbish_and_short_messages_are_none() -> None:
    layout = JointStateLayout('stage', ('x', 'y'), (2, 2, 0))
    data = layout.encode(STAMP, (1.0, 2.0), (3.0, 4.0))
    reader = JointStateReader()
    assert reader.read(data) is not None
    for broken in (b'', data[:3], data[:40], b'\xff' * len(data), data[:16] + b'\xff' * 60):
        assert layout.decode(broken) is None
        assert reader.read(broken) is None


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=80).map(lambda tail: b'\0\x01\0\0' + tail))
def test_damaged_bytes_end_no_reader(data: bytes) -> None:
    sample = JointStateReader().read(data)
    assert sample is None or isinstance(sample.stamp, int)
