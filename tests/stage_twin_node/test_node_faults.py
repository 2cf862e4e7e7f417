"""Faults on the tracker's wire with the nodes as processes, in real time."""

import contextlib
import os
import socket
import time
from pathlib import Path

from stage_bringup.graph import free_port
from stage_core import topics

from ..node_process import node
from ..patience import PATIENCE


def test_tracker_absent_then_there_faulty_killed_and_back(ros_env):
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import PointStamped

    from stage_core.ros.client_node import GraphClient
    from stage_core.ros.node import STATE_QOS, stamp_of

    drive, port = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM)
    stamps = []
    states = {}

    def remember(message):
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            states[status.name] = (status.message, values)

    def counter(name):
        return int(states.get('tracker_bridge: stream', ('', {}))[1].get(name, 0))

    # The stack ends every node even when ending one of them fails.
    with contextlib.ExitStack() as stack, GraphClient() as client:
        client.watch(DiagnosticArray, topics.DIAGNOSTICS, callback=remember)
        client.watch(
            PointStamped,
            topics.TRACKER_POINT,
            STATE_QOS,
            lambda m: stamps.append(stamp_of(m.header)),
        )

        def growing(what):
            count = len(stamps)
            client.wait_for(lambda: len(stamps) > count + 20, PATIENCE, what)

        def told(name, *words):
            """Wait until a status of the bridge holds some words."""
            client.wait_for(
                lambda: all(
                    word in states.get(f'tracker_bridge: {name}', ('',))[0] for word in words
                ),
                PATIENCE,
                f'{name}: {words}',
            )

        def memory():
            pages = Path(f'/proc/{bridge.pid}/statm').read_text().split()[1]
            return int(pages) * os.sysconf('SC_PAGE_SIZE')

        def fault(name):
            client.set_parameters('/stage_twin', tracker_fault=name)

        bridge = stack.enter_context(node('tracker_bridge.node', ros_env, port=port))
        told('connection', f'no tracker at 127.0.0.1:{port}', 'check that the tracker controller')
        twin = {'drive_port': drive, 'tracker_port': port}
        first = node('stage_twin.node', ros_env, **twin, tracker_clock_offset=12345.0)
        first = stack.enter_context(first)
        growing('points of the first tracker')
        # The offset brings the controller's clock back to ROS time.
        now = time.time_ns()
        assert -1e9 < now - stamps[-1] < 10e9

        before = memory()
        for name in ('out_of_order', 'flood'):
            fault(name)
            growing(f'points in spite of {name}')
        assert memory() < before + 50 * 2**20
        fault('stall')
        told('stream', 'no point for', 'check the tracker')
        fault('none')
        client.wait_for(
            lambda: 'no point for' not in states['tracker_bridge: stream'][0], PATIENCE, 'no stall'
        )
        growing('points after a stall')
        fault('beam_lost')
        told('connection', 'beam lost')
        assert counter('bad_status') >= 1
        fault('duplicate')
        client.wait_for(lambda: counter('duplicates') > 20, PATIENCE, 'duplicates')
        growing('points among duplicates')
        fault('time_jump')
        told('stream', '~/reset')
        fault('none')
        client.trigger('/tracker_bridge/reset', PATIENCE)
        growing('points after ~/reset')

        first.kill()
        told('connection', 'no tracker')
        # The controller's clock went on, with the jump that it had made.
        again = node('stage_twin.node', ros_env, **twin, tracker_clock_offset=12350.0)
        stack.enter_context(again)
        growing('points of the restarted tracker')
        assert bridge.poll() is None
        assert stamps == sorted(set(stamps))
