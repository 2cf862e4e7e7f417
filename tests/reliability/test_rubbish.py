"""Rubbish on every topic of the running graph: no node ends, nothing moves, the reason is told."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PointStamped, TransformStamped, Vector3Stamped, WrenchStamped
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import String

from session_bags.bag import open_bag
from session_bags.info import contents
from stage_core import topics
from stage_core.errors import StageError
from stage_core.ros.node import LATCHED_QOS, SETPOINT_QOS, STATE_QOS

from ..patience import PATIENCE
from .rig import Nodes, Watch

BAD_NUMBERS = (math.nan, math.inf, -math.inf, 1e300, -1e300, 0.2)
NAMES = ([], ['x'], ['y', 'x'], ['x', 'x'], ['z'], ['x', 'y', 'z'], [''], ['x'] * 5000, ['\u2207'])
#: What a parser of JSON or YAML may meet; the nesting is deeper than Python's own recursion.
TEXTS = (
    '', 'null', '[]', '{}', '5', '"x"', '{"active": true}', '{"active": true, "file": 5}',
    '{"active": true, "file": "/etc/passwd"}', '{"active": true, "file": "/no/such"}',
    '[' * 100_000, '{"a":' * 100_000, 'kind: nurbs', 'points: [[0, .nan], [1e300, 0]]',
    '&a [*a, *a]', '!!python/object/apply:os.system ["touch /tmp/owned"]', '\x01', '- ' * 5000,
)  # fmt: skip
STAMPS = ((0, 0), (-(2**31), 0), (2**31 - 1, 2**32 - 1))


def joint_states() -> Iterator[JointState]:
    """Names, positions and velocities that no axis has; none is a move that could be executed."""
    for names, stamp in itertools.product(NAMES, STAMPS):
        for number in BAD_NUMBERS:
            for sizes in ((0, 0), (len(names), 0), (0, len(names)), (1, 3), (3, 1)):
                message = JointState(name=names, position=[number] * sizes[0])
                message.velocity = [100.0 * number] * sizes[1]
                message.effort = [number] * sizes[1]
                message.header.stamp.sec, message.header.stamp.nanosec = stamp
                yield message


def others() -> Iterator[tuple[str, Any]]:
    """Messages of every other type, with their topic."""
    for number, (sec, nanosec) in itertools.product((*BAD_NUMBERS, 0.0), STAMPS):
        for kind, topic in (
            (PointStamped, topics.TRACKER_POINT),
            (TransformStamped, topics.ALIGNMENT),
            (Vector3Stamped, topics.CONTOUR_ERROR),
            (WrenchStamped, topics.CONTACT_FORCE),
            (Temperature, topics.TEMPERATURE),
        ):
            message = kind()
            message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
            if kind is PointStamped:
                message.point.x = message.point.y = number
            elif kind is TransformStamped:
                message.transform.rotation.w = message.transform.translation.x = number
            elif kind is Temperature:
                message.header.frame_id, message.temperature = '../x', number
            yield topic, message
    for text in TEXTS:
        yield topics.MODEL, String(data=text)
        yield '/contour_ctrl/curve', String(data=text)
        status = DiagnosticStatus(name=text[:200], message=text[:200])
        yield topics.DIAGNOSTICS, DiagnosticArray(status=[status] * 3)


@pytest.fixture(scope='module')
def whole(graph: Callable[..., Any]) -> Iterator[tuple[Nodes, Watch]]:
    """The graph of a session in lockstep: virtual time passes only while something moves."""
    with graph(contour_ctrl={'contour': 'freeform'}, calibrator={'adapt': True}) as (nodes, watch):
        for name in nodes.commands:
            watch.wait(lambda name=name: told(watch, name), f'{name} on /diagnostics')
        watch.home()
        yield nodes, watch


def told(watch: Watch, node: str, since: float = 0.0) -> bool:
    """Whether a node has spoken on /diagnostics since a monotonic time [s]."""
    states = list(watch.states.items())
    return any(name.startswith(f'{node}:') and state[3] > since for name, state in states)


def test_rubbish_on_every_topic_ends_no_node_and_moves_nothing(
    whole: tuple[Nodes, Watch], tmp_path: Path
) -> None:
    nodes, watch = whole
    client = watch.client
    bag = client.trigger('/session_recorder/start', PATIENCE).split()[-1]
    watch.silent(watch.encoder)
    ticks = watch.value('stage_driver: state', 'tick')
    publishers: dict[str, Any] = {}

    def publish(topic: str, message: Any) -> None:
        if topic not in publishers:
            latched = topic in topics.LATCHED or topic.endswith('curve')
            qos = LATCHED_QOS if latched else STATE_QOS
            qos = SETPOINT_QOS if topic in (topics.SETPOINT, topics.TARGET) else qos
            publishers[topic] = client.node.create_publisher(type(message), topic, qos)
            if topic != topics.CONTACT_FORCE:
                watch.wait(lambda: publishers[topic].get_subscription_count() > 0, topic)
        publishers[topic].publish(message)

    for count, message in enumerate(joint_states()):
        publish((topics.SETPOINT, topics.TARGET)[count % 2], message)
        if count % 5 == 0:
            for topic in (topics.REFERENCE, topics.COMMAND, topics.JOINT_STATES):
                publish(topic, message)
    for topic, message in others():
        publish(topic, message)
    # A set-point that is refused says why; then every node has spoken again and lives.
    publish(topics.SETPOINT, JointState(name=['x'], position=[math.nan]))
    refusal = 'position of x is nan'
    watch.wait(lambda: refusal in watch.value('stage_driver: set-points', 'last_refusal'), 'words')
    now = max(state[3] for state in list(watch.states.values()))
    for name in nodes.commands:
        watch.wait(lambda name=name: told(watch, name, now + 1.0) or name in nodes.dead(), name)
    assert nodes.dead() == [], [nodes.log(name)[-2000:] for name in nodes.dead()]
    assert watch.value('stage_driver: state', 'tick') == ticks
    assert watch.text('stage_driver: state') == 'ready'
    # What works on what was heard answers with a reason.
    for service in ('/calibrator/retrain', '/contour_ctrl/run', '/tracker_bridge/align'):
        with pytest.raises(StageError, match=f'{service} failed: .'):
            client.trigger(service, PATIENCE)
    client.trigger('/session_recorder/stop', PATIENCE)
    assert sum(contents(open_bag(bag)).counts.values()) > 1000
    assert not Path('/tmp/owned').exists()
    # And the graph still works.
    assert nodes.dead() == []
    watch.encoder.clear()
    watch.move(0.01, 0.0)
    watch.wait(watch.arrived(0.01, 0.0), 'a move')
