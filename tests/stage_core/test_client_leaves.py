"""A client that is closed is no longer in the graph, though its process goes on."""

from __future__ import annotations

import os

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

import rclpy
from geometry_msgs.msg import PointStamped

from stage_core import topics
from stage_core.ros.client_node import GraphClient


def sockets() -> int:
    """Open sockets of this process."""
    found = 0
    for entry in os.scandir('/proc/self/fd'):
        try:
            found += os.readlink(entry.path).startswith('socket:')
        except OSError:  # the folder's own descriptor
            continue
    return found


@pytest.mark.usefixtures('ros_env')
def test_a_closed_client_leaves_the_graph() -> None:
    GraphClient().close()  # the middleware keeps some sockets for the whole process
    before = sockets()
    with GraphClient() as client:
        client.watch(PointStamped, topics.TRACKER_POINT)
        assert sockets() > before
    assert sockets() == before


@pytest.mark.usefixtures('ros_env')
def test_a_client_ends_what_it_began_and_nothing_else() -> None:
    """The context of a node that runs in the same process goes on."""
    rclpy.init()
    try:
        GraphClient().close()
        assert rclpy.ok()
    finally:
        rclpy.shutdown()
    GraphClient().close()
    assert not rclpy.ok()
