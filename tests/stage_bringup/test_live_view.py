"""The live view passes the graph's messages on; the server is a stand-in or the real SDK."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from session_bags.definitions import definition
from stage_bringup.live_view_node import Thinner, channel
from stage_core import topics

STAND_IN = """
import pathlib, os
class Schema:
    def __init__(self, *, name, encoding, data):
        self.name, self.encoding, self.data = name, encoding, data
class Channel:
    def __init__(self, topic, *, message_encoding, schema):
        self.topic = topic
    def log(self, data):
        with open(os.environ['LIVE_VIEW_LOG'], 'a') as out:
            out.write(f'{self.topic} {bytes(data).hex()}\\n')
def start_server(*, name, host, port):
    class Server:
        def stop(self):
            pathlib.Path(os.environ['LIVE_VIEW_LOG'] + '.stopped').touch()
    return Server()
"""


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


def test_node_without_the_sdk_says_what_to_install(ros_env: dict[str, str]) -> None:
    if importlib.util.find_spec('foxglove') is not None:
        pytest.skip('foxglove-sdk is installed')
    run = subprocess.run(
        [sys.executable, '-m', 'stage_bringup.live_view_node'],
        env=ros_env,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert run.returncode == 2
    assert 'pip install foxglove-sdk' in run.stderr
    assert len(run.stderr.strip().splitlines()) == 1


def test_node_passes_messages_on(ros_env: dict[str, str], tmp_path: Path) -> None:
    """What is published reaches the channel of its topic; SIGTERM stops the server."""
    from std_msgs.msg import String

    from stage_node.client_node import GraphClient
    from stage_node.node import LATCHED_QOS

    (tmp_path / 'foxglove.py').write_text(STAND_IN)
    log = tmp_path / 'log'
    path = os.pathsep.join([str(tmp_path), ros_env.get('PYTHONPATH', '')])
    env = {**ros_env, 'PYTHONPATH': path, 'LIVE_VIEW_LOG': str(log)}
    node = subprocess.Popen([sys.executable, '-m', 'stage_bringup.live_view_node'], env=env)
    try:
        with GraphClient('live_view_test') as client:
            publisher = client.node.create_publisher(String, topics.MODEL, LATCHED_QOS)
            publisher.publish(String(data='{"active": false}'))
            deadline = time.monotonic() + 60.0
            while time.monotonic() < deadline and not (
                log.exists() and 'model' in log.read_text()
            ):
                time.sleep(0.1)
        line = next(text for text in log.read_text().splitlines() if topics.MODEL in text)
        assert b'{"active": false}' in bytes.fromhex(line.split()[1])
    finally:
        node.terminate()
        node.wait(timeout=60)
    assert (tmp_path / 'log.stopped').exists()
