"""A second bridge on a tracker's connection is refused, by the name of the first."""

from diagnostic_msgs.msg import DiagnosticArray

from stage_bringup.graph import free_port
from stage_core import topics
from stage_core.ros.client_node import GraphClient

from ..node_process import node, start
from ..patience import PATIENCE

BRIDGE = 'tracker_bridge.node'


def test_a_tracker_connection_has_one_bridge(ros_env):
    port = free_port()
    with node(BRIDGE, ros_env, port=port) as first, GraphClient('test_client') as client:
        client.watch(DiagnosticArray, topics.DIAGNOSTICS)
        client.wait_for(lambda: client.latest(topics.DIAGNOSTICS), PATIENCE, 'the first bridge')
        second = start(BRIDGE, ros_env, port=port, host='localhost')
        said = second.communicate()[0]
    assert second.returncode == 2
    assert f'tracker_bridge with pid {first.pid} (since ' in said
    assert f'holds the tracker connection 127.0.0.1:{port}: stop it, or give this bridge' in said
