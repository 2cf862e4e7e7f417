"""Faults on the tracker's wire with the nodes as processes, in real time."""

import contextlib
import os
import select
import signal
import socket
import subprocess
import sys
import time

from stage_bringup.graph import free_port
from stage_core import topics

from ..patience import PATIENCE


class NodeProcess:
    """A node whose output is read while it runs."""

    def __init__(self, module, env, *parameters):
        arguments = [item for pair in parameters for item in ('-p', pair)]
        self.process = subprocess.Popen(
            [sys.executable, '-m', module, '--ros-args', *arguments],
            env=env,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        self.output = ''

    def said(self, text, timeout=PATIENCE):
        deadline = time.monotonic() + timeout
        while text not in self.output and time.monotonic() < deadline:
            if select.select([self.process.stdout], [], [], 0.1)[0]:
                self.output += os.read(self.process.stdout.fileno(), 65536).decode()
        return text in self.output

    def end(self, number=signal.SIGTERM):
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            return self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        finally:
            self.process.stdout.close()


@contextlib.contextmanager
def nodes():
    # The stack ends every node even when ending one of them fails.
    with contextlib.ExitStack() as stack:

        def start(*arguments):
            node = NodeProcess(*arguments)
            stack.callback(node.end)
            return node

        yield start


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

    with nodes() as start, GraphClient() as client:
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

        bridge = start('tracker_bridge.node', ros_env, f'port:={port}')
        assert bridge.said(f'no tracker at 127.0.0.1:{port}')
        assert bridge.said('check that the tracker controller is on')
        twin = ('stage_twin.node', ros_env, f'drive_port:={drive}', f'tracker_port:={port}')
        first = start(*twin, 'tracker_clock_offset:=12345.0')
        growing('points of the first tracker')
        # The offset brings the controller's clock back to ROS time.
        now = time.time_ns()
        assert -1e9 < now - stamps[-1] < 10e9

        client.set_parameters('/stage_twin', tracker_fault='beam_lost')
        client.wait_for(
            lambda: 'beam lost' in states['tracker_bridge: connection'][0], PATIENCE, 'the loss'
        )
        assert counter('bad_status') >= 1
        client.set_parameters('/stage_twin', tracker_fault='duplicate')
        client.wait_for(lambda: counter('duplicates') > 20, PATIENCE, 'duplicates')
        growing('points among duplicates')
        client.set_parameters('/stage_twin', tracker_fault='time_jump')
        client.wait_for(
            lambda: '~/reset' in states['tracker_bridge: stream'][0],
            PATIENCE,
            'the jump being told',
        )
        client.set_parameters('/stage_twin', tracker_fault='none')
        client.trigger('/tracker_bridge/reset', PATIENCE)
        growing('points after ~/reset')

        first.end(signal.SIGKILL)
        client.wait_for(
            lambda: 'no tracker' in states['tracker_bridge: connection'][0], PATIENCE, 'the loss'
        )
        # The controller's clock went on, with the jump that it had made.
        start(*twin, 'tracker_clock_offset:=12350.0')
        growing('points of the restarted tracker')
        assert bridge.process.poll() is None
        assert stamps == sorted(set(stamps))
