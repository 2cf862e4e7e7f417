"""The live view passes the graph's messages on to a browser, over the real server."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
import struct
import subprocess
import threading
import urllib.request
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from session_bags.definitions import definition
from stage_bringup.graph import free_port
from stage_bringup.live_state_node import LiveState
from stage_bringup.live_view_node import Thinner, channel
from stage_core import topics

from ..node_process import end, start
from ..patience import PATIENCE, wait


def test_thinner_keeps_the_rate() -> None:
    now = [0.0]
    thinner = Thinner(lambda: now[0])
    passed = 0
    for k in range(10_000):
        now[0] = k * 1e-3
        passed += thinner.passes(30.0)
    assert 299 <= passed <= 301


def test_thinner_does_not_catch_up_after_a_pause() -> None:
    now = [0.0]
    thinner = Thinner(lambda: now[0])
    assert thinner.passes(10.0)
    now[0] = 60.0
    assert [thinner.passes(10.0) for _ in range(5)].count(True) <= 2


def test_channel_carries_the_message_definition() -> None:
    sdk = SimpleNamespace(
        Schema=lambda **values: values, Channel=lambda topic, **values: (topic, values)
    )
    topic, values = channel(sdk, topics.JOINT_STATES)
    assert topic == '/stage/joint_states'
    assert values['message_encoding'] == 'cdr'
    assert values['schema']['encoding'] == 'ros2msg'
    assert values['schema']['data'].decode() == definition('sensor_msgs/msg/JointState')[0]


def node(said: list[str] | None = None) -> SimpleNamespace:
    log = SimpleNamespace(warning=(said if said is not None else []).append)
    return SimpleNamespace(create_client=lambda *_: None, get_logger=lambda: log)


def test_while_a_contour_is_followed_the_error_is_the_controllers() -> None:
    from geometry_msgs.msg import Vector3, Vector3Stamped
    from rclpy.serialization import serialize_message

    from stage_core.ros.node import joint_state

    state = LiveState(node())
    # In real time the driver follows the reference of the tick before.
    state.keep_reference(serialize_message(joint_state(1, 'xy', position=[30e-6, 0.0])))
    encoder = joint_state(1, 'xy', position=[0.0, 0.0])
    state.take(topics.JOINT_STATES, serialize_message(encoder))
    assert state.now()['error'] == [30e-6, 0.0]
    error = Vector3Stamped(vector=Vector3(x=1e-6, y=2e-6, z=3e-6))
    state.take(topics.CONTOUR_ERROR, serialize_message(error))
    shown = state.now()
    assert (shown['error'], shown['contour']) == ([1e-6, 2e-6], 3e-6)


LIVE_VIEW = 'stage_bringup.live_view_node'


def test_what_is_no_number_and_an_alignment_without_a_rotation_end_nothing() -> None:
    from geometry_msgs.msg import PointStamped, TransformStamped, Vector3Stamped
    from rclpy.serialization import serialize_message

    said: list[str] = []
    state = LiveState(node(said))
    point, contour, nowhere = PointStamped(), Vector3Stamped(), TransformStamped()
    nowhere.transform.rotation.w = 0.0
    point.point.x = contour.vector.z = float('nan')
    for topic, message in (
        (topics.ALIGNMENT, nowhere),
        (topics.TRACKER_POINT, point),
        (topics.CONTOUR_ERROR, contour),
    ):
        state.take(topic, serialize_message(message))
    assert len(said) == 1 and 'alignment' in said[0]
    shown = json.loads(json.dumps(state.now(), allow_nan=False))
    assert shown['tracker'] is None and shown['contour'] is None
    point.point.x = 0.5
    state.take(topics.TRACKER_POINT, serialize_message(point))
    assert state.now()['tracker'] == [0.5, 0.0, 0.0]


def test_node_without_the_sdk_serves_its_page(ros_env: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / 'foxglove.py').write_text('raise ImportError')
    path = os.pathsep.join([str(tmp_path), ros_env.get('PYTHONPATH', '')])
    port = free_port()
    node = start(LIVE_VIEW, {**ros_env, 'PYTHONPATH': path}, page_port=port)
    try:
        wait_for_server(port, node)
        with urllib.request.urlopen(f'http://127.0.0.1:{port}/', timeout=PATIENCE) as page:
            assert 'Stop the stage' in page.read().decode()
    finally:
        output = end(node)
    assert node.returncode == 0
    assert 'pip install foxglove-sdk' in output


async def first_messages(port: int, wanted: set[str]) -> dict[str, tuple[dict[str, str], bytes]]:
    """Advertised channel and first message of each wanted topic, as a browser gets them."""
    from tornado.httpclient import HTTPRequest
    from tornado.websocket import websocket_connect

    patient = HTTPRequest(f'ws://127.0.0.1:{port}', connect_timeout=0.0, request_timeout=0.0)
    browser = await websocket_connect(patient, subprotocols=['foxglove.sdk.v1'])
    channels: dict[int, dict[str, str]] = {}
    found: dict[str, tuple[dict[str, str], bytes]] = {}
    while set(found) != wanted:
        frame = await browser.read_message()
        if isinstance(frame, bytes):
            # Message data: opcode 1, id of the subscription, log time, payload.
            opcode, identity, _ = struct.unpack_from('<BIQ', frame)
            if opcode == 1:
                found[channels[identity]['topic']] = (channels[identity], frame[13:])
            continue
        message = json.loads(frame)
        if message['op'] == 'advertise':
            new = {c['id']: c for c in message['channels'] if c['topic'] in wanted}
            channels |= new
            asked = [{'id': identity, 'channelId': identity} for identity in new]
            await browser.write_message(json.dumps({'op': 'subscribe', 'subscriptions': asked}))
    browser.close()
    return found


def newest_state(port: int) -> dict[str, Any]:
    """The first state of a stream of the page."""
    with urllib.request.urlopen(f'http://127.0.0.1:{port}/events', timeout=PATIENCE) as stream:
        return json.loads(stream.readline().removeprefix(b'data: '))


def state_with_an_error(port: int) -> dict[str, Any]:
    """State of the page once it holds an error and a node."""
    state: dict[str, Any] = {}

    def complete() -> bool:
        state.update(newest_state(port))
        return bool(state['error'] and state['states'])

    wait(complete, lambda: f'an error and a node: {state}')
    return state


def post_stop(port: int) -> str:
    request = urllib.request.Request(f'http://127.0.0.1:{port}/stop', method='POST')
    with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
        return answer.read().decode()


def answer_stop(_: Any, response: Any) -> Any:
    response.success, response.message = True, 'the test is at rest'
    return response


def test_a_browser_gets_the_messages_of_the_graph(ros_env: dict[str, str]) -> None:
    """Over the real server: channels with their definitions, and bytes that decode."""
    pytest.importorskip('foxglove', reason='foxglove-sdk is an optional extra')
    pytest.importorskip('tornado', reason='comes with Dask, an optional extra')
    from mcap.records import Schema
    from mcap_ros2.decoder import DecoderFactory
    from sensor_msgs.msg import JointState
    from std_msgs.msg import String
    from std_srvs.srv import Trigger

    from stage_core.ros.client_node import GraphClient
    from stage_core.ros.node import LATCHED_QOS, STATE_QOS, joint_state

    port, page_port = free_port(), free_port()
    node = start(LIVE_VIEW, ros_env, port=port, page_port=page_port)
    ended = threading.Event()
    try:
        with GraphClient('live_view_test') as client:
            model = client.node.create_publisher(String, topics.MODEL, LATCHED_QOS)
            model.publish(String(data='{"active": false}'))
            states = client.node.create_publisher(JointState, topics.JOINT_STATES, STATE_QOS)
            references = client.node.create_publisher(JointState, topics.REFERENCE, STATE_QOS)

            def publish() -> None:
                tick = 0
                while not ended.wait(0.05):
                    tick += 1
                    states.publish(joint_state(tick, 'xy', position=[0.25, -0.5]))
                    # The reference of this tick, and one of another tick, which must not count.
                    references.publish(joint_state(tick, 'xy', position=[0.25 + 1e-6, -0.5]))
                    references.publish(joint_state(tick + 10**6, 'xy', position=[0.3, 0.3]))

            thread = threading.Thread(target=publish)
            thread.start()
            try:
                wait_for_server(port, node)
                wanted = {topics.MODEL, topics.JOINT_STATES, topics.DIAGNOSTICS}
                got = asyncio.run(asyncio.wait_for(first_messages(port, wanted), PATIENCE))
                shown = state_with_an_error(page_port)
                stop_without_driver = post_stop(page_port)
                client.node.create_service(Trigger, '/stage_driver/stop', answer_stop)
                wait(lambda: 'test is at rest' in post_stop(page_port), 'the stop')
            finally:
                ended.set()
                thread.join()
        assert shown['position'] == [0.25, -0.5]
        assert shown['error'] == pytest.approx([1e-6, 0.0], abs=1e-12)
        assert any(row['name'] == 'live_view: view' for row in shown['states'])
        assert 'emergency stop' in stop_without_driver
        for topic, (advertised, _) in got.items():
            assert advertised['encoding'] == 'cdr'
            assert advertised['schemaEncoding'] == 'ros2msg'
            assert advertised['schemaName'] == topics.TOPIC_TYPES[topic]

        def decoded(topic: str):
            advertised, data = got[topic]
            text = advertised['schema'].encode()
            schema = Schema(1, text, 'ros2msg', advertised['schemaName'])
            decode = DecoderFactory().decoder_for('cdr', schema)
            assert decode is not None
            return decode(data)

        assert list(decoded(topics.JOINT_STATES).position) == [0.25, -0.5]
        assert decoded(topics.MODEL).data == '{"active": false}'
        assert decoded(topics.DIAGNOSTICS).status[0].name.startswith('live_view')
    finally:
        end(node)
    assert node.returncode == 0


def wait_for_server(port: int, node: subprocess.Popen) -> None:
    def listens() -> bool:
        assert node.poll() is None, f'the node ended with status {node.returncode}'
        with contextlib.suppress(OSError), socket.create_connection(('127.0.0.1', port), PATIENCE):
            return True
        return False

    wait(listens, f'a server on port {port}')
