"""The recorder on a disk that fills up, and bags that nothing overwrites."""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from session_bags import info
from session_bags.reader import read_session
from session_bags.repair import repair
from stage_core import topics
from stage_core.errors import StageError
from stage_core.ros.node import STATE_QOS, joint_state

from ..patience import PATIENCE

PERIOD_NS = 2_000_000
SOAK = Path(__file__).resolve().parents[2] / 'benchmarks' / 'soak_recorder.py'


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 256 KiB."""
    disk = tmp_path / 'disk'
    disk.mkdir()
    mounted = subprocess.run(
        ['mount', '-t', 'tmpfs', '-o', 'size=256k', 'tmpfs', str(disk)], capture_output=True
    )
    if mounted.returncode != 0:
        pytest.skip('a small disk needs the right to mount a tmpfs')
    yield disk
    subprocess.run(['umount', '-l', str(disk)], check=True)


def publish(publisher: Any, first: int, count: int) -> None:
    """Publish `count` messages stamped PERIOD_NS apart, faster than real time."""
    for k in range(first, first + count):
        stamp = 10**18 + k * PERIOD_NS
        publisher.publish(joint_state(stamp, ('x', 'y'), (1e-6 * k, 0.0), (0.0, 0.0)))
        if k % 20 == 0:
            time.sleep(0.01)


def test_full_disk_keeps_what_was_written(
    graph: Callable[..., Any], small_disk: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with graph(
        'session_recorder',
        clock='realtime',
        session_recorder={'directory': small_disk, 'name': 'full', 'chunk_period': 0.5},
    ) as (nodes, watch):
        client = watch.client
        publisher = client.node.create_publisher(JointState, topics.REFERENCE, STATE_QOS)
        client.wait_for_service('/session_recorder/start', PATIENCE)
        client.wait_for(lambda: publisher.get_subscription_count() > 1, PATIENCE, 'the recorder')
        path = Path(client.trigger('/session_recorder/start', PATIENCE))
        sent = 0
        while not watch.says('session_recorder: recording', 'free space')() and sent < 200_000:
            publish(publisher, sent, 1000)
            sent += 1000
        watch.wait(watch.says('session_recorder: recording', 'free space'), 'the full disk')
        # The node lives and says why it cannot go on.
        assert nodes.dead() == []
        with pytest.raises(StageError, match='free space'):
            client.trigger('/session_recorder/stop', PATIENCE)
        rest = small_disk.parent / 'rest'
        subprocess.run(['cp', '-r', str(path), str(rest)], check=True)
    repair(rest)
    stamps = read_session(rest).series[topics.REFERENCE].stamps
    numbers = (stamps - 10**18) // PERIOD_NS
    assert np.all(np.diff(numbers) == 1)
    # What is missing at the end is one open chunk: half a second of arrivals.
    assert len(numbers) > 1000
    assert info.main([str(rest)]) == 0
    assert f'{len(numbers)}' in capfd.readouterr().out


def digest(path: Path) -> str:
    return hashlib.sha256(
        b''.join(file.read_bytes() for file in sorted(path.rglob('*')) if file.is_file())
    ).hexdigest()


def test_a_recorder_that_got_no_processor_for_a_while_loses_nothing() -> None:
    # The socket holds a tenth of it; the rest is asked for before the publisher forgets it.
    done = subprocess.run(
        [sys.executable, str(SOAK), '--minutes', '0.1', '--rate', '500', '--held', '0.4'],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert 'recorder suspended' in done.stdout and ' 0 lost' in done.stdout


def test_nothing_overwrites_a_bag(graph: Callable[..., Any], tmp_path: Path) -> None:
    with graph(
        'session_recorder',
        clock='realtime',
        session_recorder={'directory': tmp_path, 'name': 'same', 'topics': ['/stage/reference']},
    ) as (nodes, watch):
        client = watch.client
        publisher = client.node.create_publisher(JointState, topics.REFERENCE, STATE_QOS)
        client.wait_for_service('/session_recorder/start', PATIENCE)
        client.wait_for(lambda: publisher.get_subscription_count() > 1, PATIENCE, 'the recorder')
        known: dict[Path, str] = {}
        for round_number in range(4):
            path = Path(client.trigger('/session_recorder/start', PATIENCE))
            assert path not in known
            publish(publisher, 100 * round_number, 100)
            if round_number == 1:
                # Killed while it records: the next one must not touch what it left.
                time.sleep(1.2)
                nodes.kill('session_recorder')
                nodes.run('session_recorder')
                client.wait_for(lambda: _answers(client), PATIENCE, 'the recorder')
            else:
                client.trigger('/session_recorder/stop', PATIENCE)
            known[path] = digest(path)
        for path, before in known.items():
            assert digest(path) == before
    for bad in ('../outside', '/tmp/outside'):
        command = nodes.commands['session_recorder'].arguments()
        process = subprocess.Popen(
            [*command, '-p', f'name:={bad}'],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=os.environ.copy(),
        )
        try:
            output = process.communicate()[0].decode()
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGKILL)
        assert process.returncode == 2 and 'name must be letters' in output
    assert {p.name for p in tmp_path.iterdir()} == {p.name for p in known}


def _answers(client: Any) -> bool:
    try:
        client.trigger('/session_recorder/stop', 1.0)
    except StageError as error:
        return 'not recording' in str(error)
    return False
