"""The twin's node and the bridge's node as processes, with a driver of a few lines between."""

import contextlib
import re
import socket

import numpy as np
import pytest
import yaml

from stage_bringup.graph import free_port
from stage_core import drive_link, topics
from stage_core.frames import alignment_in
from stage_core.twin_file import TwinFile

from ..node_process import node
from ..patience import PATIENCE

ANGLE, OFFSET = 0.3, (0.25, -0.4)
PLACES = [(0.0, 0.0), (0.03, 0.0), (0.03, 0.03), (-0.02, 0.025), (0.0, -0.03)]


class SmallDriver:
    """Position control by a spring and a damper on the encoder; publishes /stage/joint_states."""

    def __init__(self, port, client):
        from sensor_msgs.msg import JointState

        from stage_core.ros.node import STATE_QOS

        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(('127.0.0.1', port))
        self.socket.settimeout(0.5)
        self.publisher = client.node.create_publisher(JointState, topics.JOINT_STATES, STATE_QOS)
        client.wait_for(
            lambda: self.publisher.get_subscription_count() > 0, PATIENCE, 'the bridge listening'
        )
        self.now = None
        self.before = np.zeros(2)
        self.stamp = 0

    def next_encoder(self):
        while True:
            try:
                datagram = drive_link.decode(self.socket.recv(2048))
            except (TimeoutError, ConnectionRefusedError):
                if self.now is None:
                    self.socket.send(drive_link.encode_hello())
                continue
            if self.now is None or datagram.tick > self.now.tick:
                return datagram

    def publish(self):
        from stage_core.ros.node import joint_state

        self.publisher.publish(joint_state(self.now.stamp, 'xy', self.now.values, (0.0, 0.0)))

    def go(self, place, ticks):
        """Jerk-free blend to a place, then rest; `ticks` in all."""
        if self.now is None:
            self.socket.send(drive_link.encode_hello())
            self.now = self.next_encoder()
            self.publish()
        begin, end = np.array(self.now.values), np.array(place)
        mass = np.array([18.0, 8.0])
        for index in range(ticks):
            s = min(index / (0.4 * ticks), 1.0)
            wanted = begin + (end - begin) * s**3 * (10 - 15 * s + 6 * s * s)
            q = np.array(self.now.values)
            speed = (q - self.before) / 1e-3
            self.before = q
            force = mass * (14400.0 * (wanted - q) - 216.0 * speed)
            data = drive_link.encode_force(self.now.tick, self.now.stamp, tuple(force))
            self.socket.send(data)
            self.now = self.next_encoder()
            self.publish()

    def close(self):
        self.socket.close()


def tracker_connected(client):
    message = client.latest(topics.DIAGNOSTICS)
    return message is not None and any(
        status.name == 'tracker_bridge: connection' and status.message == 'connected'
        for status in message.status
    )


def session(ros_env, twin):
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import PointStamped, TransformStamped

    from stage_core.ros.client_node import GraphClient
    from stage_core.ros.node import LATCHED_QOS, STATE_QOS, stamp_of

    drive, tracker = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM)
    points = []
    with contextlib.ExitStack() as stack:
        stack.enter_context(
            node(
                'stage_twin.node',
                ros_env,
                twin=twin,
                clock='lockstep',
                seed=5,
                drive_port=drive,
                tracker_port=tracker,
            )
        )
        stack.enter_context(
            node(
                'tracker_bridge.node',
                ros_env,
                port=tracker,
                source_clock='ros',
                use_sim_time=True,
            )
        )
        client = stack.enter_context(GraphClient(use_sim_time=True))
        client.watch(
            PointStamped,
            topics.TRACKER_POINT,
            STATE_QOS,
            lambda m: points.append((stamp_of(m.header), m.point.x, m.point.y, m.point.z)),
        )
        client.watch(TransformStamped, topics.ALIGNMENT, LATCHED_QOS)
        client.watch(DiagnosticArray, topics.DIAGNOSTICS)
        client.wait_for(lambda: tracker_connected(client), PATIENCE, 'the tracker connecting')
        driver = SmallDriver(drive, client)
        stack.callback(driver.close)
        for place in PLACES:
            driver.go(place, 800)
        message = client.trigger('/tracker_bridge/align', PATIENCE)
        client.wait_for(lambda: client.latest(topics.ALIGNMENT) is not None, PATIENCE, 'alignment')
        last = driver.now.stamp
        client.wait_for(lambda: points and points[-1][0] >= last - 10_000_000, PATIENCE, 'points')
        client.trigger('/tracker_bridge/reset', PATIENCE)
        with pytest.raises(Exception, match='rests of the stage'):
            client.trigger('/tracker_bridge/align', PATIENCE)
        return message, client.latest(topics.ALIGNMENT), points


def test_alignment_in_lockstep_finds_the_planted_transform(ros_env, tmp_path):
    reality = TwinFile.nominal_servo().with_effects(
        {'tracker_misalignment': {'angle': ANGLE, 'offset_x': OFFSET[0], 'offset_y': OFFSET[1]}}
    )
    path = tmp_path / 'reality.yaml'
    path.write_text(yaml.safe_dump(reality.to_dict()))
    message, transform, points = session(ros_env, path)
    # A slow settling may be split into two rests, never the other way round.
    assert int(re.search(r'from (\d+) rests', message)[1]) >= len(PLACES)
    # The bridge connects during virtual time 1 s; from then on no point is lost.
    stamps = [point[0] for point in points]
    assert stamps == sorted(set(stamps))
    assert len(stamps) >= 5 * 80
    assert set(np.diff(stamps)) == {10_000_000}
    found = alignment_in(transform)
    cosine, sine = np.cos(ANGLE), np.sin(ANGLE)
    planted = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    # measured = R p + offset; the alignment takes it back. 1 µm of noise, some 50 points a rest.
    for place in [(0.0, 0.0, 0.0), (0.03, 0.03, 0.0)]:
        measured = planted @ np.array(place) + np.array([*OFFSET, 0.0])
        assert np.linalg.norm(found.apply(measured) - place) < 1.5e-6
