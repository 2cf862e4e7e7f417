"""The recorder and the player as processes on the graph."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from session_bags.bag import open_bag
from session_bags.messages import raw_messages
from session_bags.reader import read_session
from session_bags.repair import repair
from session_bags.writer import write_session
from stage_core import topics
from stage_core.session import Session

from ..patience import PATIENCE
from .conftest import PLAYER, RECORDER, assert_same, random_session

rclpy = pytest.importorskip('rclpy')

Start = Callable[..., 'subprocess.Popen[str]']

#: Publishes COUNT messages on each of six topics at 500 Hz, then waits.
PUBLISHER = """
import sys, time, rclpy
from geometry_msgs.msg import PointStamped, TransformStamped, Vector3Stamped
from sensor_msgs.msg import JointState
from stage_core import topics
from stage_core.session import Session
from stage_core.ros.node import LATCHED_QOS, STATE_QOS, joint_state, set_stamp
count = int(sys.argv[1])
rclpy.init()
node = rclpy.create_node('publisher')
names = [topics.SETPOINT, topics.REFERENCE, topics.COMMAND, topics.JOINT_STATES]
joints = [node.create_publisher(JointState, name, STATE_QOS) for name in names]
point = node.create_publisher(PointStamped, topics.TRACKER_POINT, STATE_QOS)
error = node.create_publisher(Vector3Stamped, topics.CONTOUR_ERROR, STATE_QOS)
alignment = node.create_publisher(TransformStamped, topics.ALIGNMENT, LATCHED_QOS)
transform = TransformStamped(child_frame_id='tracker')
transform.header.frame_id = 'stage'
transform.transform.rotation.w = 1.0
transform.transform.translation.x = 0.25
alignment.publish(transform)
print('ready', flush=True)
sys.stdin.readline()
begin = time.time_ns()
for k in range(count):
    stamp = begin + k * 2_000_000
    time.sleep(max(0.0, (stamp - time.time_ns()) * 1e-9))
    for publisher in joints:
        publisher.publish(joint_state(stamp, ('x', 'y'), [k * 1e-6, -k * 1e-6], [1.0, 2.0]))
    vectors = ((point, PointStamped, 'point'), (error, Vector3Stamped, 'vector'))
    for publisher, kind, field in vectors:
        message = kind()
        set_stamp(message.header, stamp)
        getattr(message, field).x = float(k)
        publisher.publish(message)
print('done', flush=True)
sys.stdin.readline()
"""
SIX = (
    topics.SETPOINT,
    topics.REFERENCE,
    topics.COMMAND,
    topics.JOINT_STATES,
    topics.TRACKER_POINT,
    topics.CONTOUR_ERROR,
)


def start_recorder(start: Start, directory: Path, *more: str) -> subprocess.Popen[str]:
    return start(RECORDER, '--ros-args', '-p', f'directory:={directory}', *more)


def publish(start: Start, count: int) -> subprocess.Popen[str]:
    process = start(PUBLISHER, str(count), stdin=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline().strip() == 'ready'
    return process


def go(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    process.stdin.write('\n')
    process.stdin.flush()


def wait_done(process: subprocess.Popen[str]) -> None:
    assert process.stdout is not None
    assert process.stdout.readline().strip() == 'done'


def wait_matched(client, topic_names: tuple[str, ...], subscribers: int = 1) -> None:
    """Wait until every topic has a publisher and the recorder's subscription."""
    client.wait_for(
        lambda: all(
            client.node.count_publishers(name)
            and client.node.count_subscribers(name) >= subscribers
            for name in topic_names
        ),
        30.0,
        'discovery of the publishers and the recorder',
    )


def test_recorder_loses_no_message_and_repeats_the_alignment(
    start_process: Start, tmp_path: Path
) -> None:
    from stage_core.ros.client_node import GraphClient

    twin = tmp_path / 'twin.yaml'
    from stage_core.twin_file import TwinFile

    TwinFile.nominal_servo().save(twin)
    start_recorder(start_process, tmp_path / 'bags', '-p', 'name:=run', '-p', f'twin:={twin}')
    count = 700
    publisher = publish(start_process, count)
    with GraphClient('test_client') as client:
        wait_matched(client, (*SIX, topics.ALIGNMENT))
        time.sleep(1.0)
        first = Path(client.trigger('/session_recorder/start'))
        with pytest.raises(Exception, match='already recording'):
            client.trigger('/session_recorder/start')
        go(publisher)
        wait_done(publisher)
        time.sleep(0.5)
        message = client.trigger('/session_recorder/stop')
        second = Path(client.trigger('/session_recorder/start'))
        client.trigger('/session_recorder/stop')
        with pytest.raises(Exception, match='another|letters'):
            client.set_parameters('/session_recorder', name='../outside')
    assert '0 dropped' in message
    assert first == tmp_path / 'bags' / 'run' and second == tmp_path / 'bags' / 'run_1'
    session = read_session(first)
    for name in SIX:
        assert len(session.series[name]) == count, name
    assert session.alignment is not None and session.alignment.translation[0] == 0.25
    assert session.twin is not None and session.twin['kind'] == 'servo'
    by_topic: dict[str, list[int]] = {}
    bag = open_bag(first)
    for raw in raw_messages(bag, SIX):
        by_topic.setdefault(raw.topic, []).append(raw.sequence)
    for name in SIX:
        assert np.all(np.diff(by_topic[name]) == 1), f'{name} lost a message'
    assert json.loads(bag.description.custom_data['dropped'])[topics.REFERENCE] == 0
    again = read_session(second, allow_nan=True, topics=[topics.TRACKER_POINT])
    assert again.alignment is not None, 'the second bag holds the alignment too'


def test_kill_loses_at_most_a_second(start_process: Start, tmp_path: Path) -> None:
    from stage_core.ros.client_node import GraphClient

    recorder = start_recorder(start_process, tmp_path, '-p', 'name:=killed')
    publisher = publish(start_process, 1000)
    with GraphClient('test_client') as client:
        wait_matched(client, SIX)
        time.sleep(0.5)
        path = Path(client.trigger('/session_recorder/start'))
        go(publisher)
        wait_done(publisher)
        # Messages that have arrived must be on the disk a chunk period later.
        time.sleep(1.0)
    os.kill(recorder.pid, signal.SIGKILL)
    recorder.wait()
    session = read_session(path)
    assert len(session.series[topics.REFERENCE]) == 1000
    assert 'unfinished' in session.warnings[0]
    (done,) = repair(path)
    assert not done.was_whole and done.messages >= 6000
    assert not read_session(path).warnings


def test_player_round_trip(start_process: Start, tmp_path: Path) -> None:
    from stage_core.ros.client_node import GraphClient

    session = random_session(300)
    bag = write_session(tmp_path / 'bag', session)
    played = [name for name in session.series if ':' not in name]
    start_recorder(start_process, tmp_path / 'again', '-p', 'name:=copy')
    chosen = [*played, topics.TEMPERATURE, topics.ALIGNMENT]
    common = (f'bag:={bag}', 'wait_for_subscribers:=true', f'topics:=[{", ".join(chosen)}]')
    with GraphClient('test_client') as client:
        client.wait_for_service('/session_recorder/start', PATIENCE)

        def copy(parameter: str) -> Session:
            path = Path(client.trigger('/session_recorder/start'))
            arguments = [word for value in (*common, parameter) for word in ('-p', value)]
            assert start_process(PLAYER, '--ros-args', *arguments).wait() == 0
            time.sleep(0.5)
            client.trigger('/session_recorder/stop')
            return read_session(path)

        whole, end = copy('rate:=0.5'), copy('start:=0.2')
    assert_same(session, whole)
    stamps = session.series[topics.REFERENCE].stamps
    np.testing.assert_array_equal(end.series[topics.REFERENCE].stamps, stamps[200:])
    # What was latched before the start is told all the same.
    assert end.alignment is not None


def test_player_refuses_what_is_not_there(start_process: Start, tmp_path: Path, bag: Path) -> None:
    missing = start_process(PLAYER, '--ros-args', '-p', f'bag:={tmp_path / "nothing"}')
    absent = start_process(
        PLAYER, '--ros-args', '-p', f'bag:={bag}', '-p', 'topics:=["/stage/nonsense"]'
    )
    out, _ = missing.communicate()
    assert missing.returncode == 2 and 'does not exist' in out and 'Traceback' not in out
    out, _ = absent.communicate()
    assert absent.returncode == 2 and '/stage/nonsense' in out
