"""The recorder and the player as processes on the graph."""

from __future__ import annotations

import json
import os
import signal
import subprocess
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
from .conftest import PLAYER, RECORDER, START, assert_same, random_session

pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticArray

from stage_core.ros.client_node import GraphClient

Start = Callable[..., 'subprocess.Popen[str]']

#: Once somebody listens, COUNT messages on each of six topics at 500 Hz; then it waits.
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
while any(p.get_subscription_count() == 0 for p in (*joints, point, error, alignment)):
    time.sleep(0.01)
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


def wait_recorded(client: GraphClient, counts: dict[str, int]) -> None:
    """Wait until the recorder says that it holds so many messages of each topic."""

    def recorded() -> bool:
        message = client.latest(topics.DIAGNOSTICS)
        told = {p.key: p.value for s in (message.status if message else ()) for p in s.values}
        return all(int(told.get(name, '0').split()[0]) >= n for name, n in counts.items())

    client.watch(DiagnosticArray, topics.DIAGNOSTICS)
    client.wait_for(recorded, PATIENCE, 'the recorder')


def test_recorder_loses_no_message_and_repeats_the_alignment(
    start_process: Start, tmp_path: Path
) -> None:
    twin = tmp_path / 'twin.yaml'
    from stage_core.twin_file import TwinFile

    TwinFile.nominal_servo().save(twin)
    start_recorder(start_process, tmp_path / 'bags', '-p', 'name:=run', '-p', f'twin:={twin}')
    count = 700
    publisher = publish(start_process, count)
    with GraphClient('test_client') as client:
        first = Path(client.trigger('/session_recorder/start', PATIENCE))
        with pytest.raises(Exception, match='already recording'):
            client.trigger('/session_recorder/start', PATIENCE)
        go(publisher)
        wait_done(publisher)
        wait_recorded(client, dict.fromkeys(SIX, count))
        message = client.trigger('/session_recorder/stop', PATIENCE)
        second = Path(client.trigger('/session_recorder/start', PATIENCE))
        client.trigger('/session_recorder/stop', PATIENCE)
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


#: A recorder on a machine that lacks a package of messages.
LACKING = 'import sys; sys.modules["lifecycle_msgs.msg"] = None; ' + RECORDER
STRANGERS = """
import sys, time, rclpy
from geometry_msgs.msg import PointStamped
from lifecycle_msgs.msg import State
from sensor_msgs.msg import JointState
from stage_core.ros.node import STATE_QOS
rclpy.init()
node = rclpy.create_node('strangers')
odd = node.create_publisher(State, '/odd', STATE_QOS)
joints = node.create_publisher(JointState, '/stage/reference', STATE_QOS)
point = node.create_publisher(PointStamped, '/tracker/point', STATE_QOS)
while not (joints.get_subscription_count() and point.get_subscription_count()):
    time.sleep(0.01)
while True:
    odd.publish(State())
    joints.publish(b'\\0\\1\\0\\0')
    point.publish(PointStamped())
    time.sleep(0.01)
"""


def test_what_is_not_recorded_is_told_and_the_rest_is_recorded(
    start_process: Start, tmp_path: Path
) -> None:
    arguments = '--ros-args', '-p', f'directory:={tmp_path}', '-p', 'topics:=["*", "/nobody"]'
    start_process(LACKING, *arguments)
    start_process(STRANGERS)
    with GraphClient('test_client') as client:
        path = client.trigger('/session_recorder/start', PATIENCE)

        def told() -> bool:
            message = client.latest(topics.DIAGNOSTICS)
            texts = [s.message for s in (message.status if message else ())]
            strange = [f'{name} is not recorded' for name in ('/nobody', '/odd', topics.REFERENCE)]
            return any(all(said in text for said in strange) for text in texts)

        client.watch(DiagnosticArray, topics.DIAGNOSTICS)
        client.wait_for(told, PATIENCE, 'what is not recorded')
        wait_recorded(client, {topics.TRACKER_POINT: 100})
        client.trigger('/session_recorder/stop', PATIENCE)
    types = open_bag(path).topic_types()
    assert topics.TRACKER_POINT in types and not types.keys() & {'/odd', topics.REFERENCE}


def test_kill_loses_at_most_a_second(start_process: Start, tmp_path: Path) -> None:
    recorder = start_recorder(start_process, tmp_path, '-p', 'name:=killed')
    publisher = publish(start_process, 1000)
    with GraphClient('test_client') as client:
        path = Path(client.trigger('/session_recorder/start', PATIENCE))
        go(publisher)
        wait_done(publisher)
        wait_recorded(client, dict.fromkeys(SIX, 1000))
        # Messages that have arrived must be on the disk a chunk period later.
        client.wait_for(
            lambda: len([*raw_messages(open_bag(path), SIX)]) == 6000, PATIENCE, 'the last chunk'
        )
    os.kill(recorder.pid, signal.SIGKILL)
    recorder.wait()
    session = read_session(path)
    assert len(session.series[topics.REFERENCE]) == 1000
    assert 'unfinished' in session.warnings[0]
    (done,) = repair(path)
    assert not done.was_whole and done.messages >= 6000
    assert not read_session(path).warnings


def test_player_round_trip(start_process: Start, tmp_path: Path) -> None:
    session = random_session(300)
    bag = write_session(tmp_path / 'bag', session)
    played = [name for name in session.series if ':' not in name]
    start_recorder(start_process, tmp_path / 'again', '-p', 'name:=copy')
    chosen = [*played, topics.TEMPERATURE, topics.ALIGNMENT]
    common = (f'bag:={bag}', 'wait_for_subscribers:=true', f'topics:=[{", ".join(chosen)}]')
    with GraphClient('test_client') as client:
        client.wait_for_service('/session_recorder/start', PATIENCE)

        def copy(parameter: str, since: int = 0) -> Session:
            path = Path(client.trigger('/session_recorder/start', PATIENCE))
            arguments = [word for value in (*common, parameter) for word in ('-p', value)]
            assert start_process(PLAYER, '--ros-args', *arguments).wait() == 0
            stamps = {name: session.series[name].stamps for name in played}
            wait_recorded(client, {n: int((s >= START + since).sum()) for n, s in stamps.items()})
            client.trigger('/session_recorder/stop', PATIENCE)
            return read_session(path)

        whole, end = copy('rate:=0.5'), copy('start:=0.2', 200_000_000)
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
    behind = start_process(
        PLAYER, '--ros-args', '-p', f'bag:={bag}', '-p', 'start:=100.0', '-p', 'delay:=0.0'
    )
    out, _ = behind.communicate()
    assert 'holds no message to replay from 100 s on' in out and 'Traceback' not in out
    out, _ = missing.communicate()
    assert missing.returncode == 2 and 'does not exist' in out and 'Traceback' not in out
    out, _ = absent.communicate()
    assert absent.returncode == 2 and '/stage/nonsense' in out
