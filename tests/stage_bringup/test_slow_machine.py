"""A session on a slow machine waits while simulated time goes on; one that fails says what it
left.
"""

from __future__ import annotations

import shlex
import time
from itertools import count
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from sensor_msgs.msg import JointState

from session_bags.writer import write_session
from stage_bringup import kernels, session
from stage_bringup.client_node import RESEND, SessionClient
from stage_bringup.graph import Options
from stage_bringup.processes import Processes
from stage_core import topics
from stage_core.errors import StageError
from stage_core.ros.node import STATE_QOS, joint_state
from stage_reports.command import main as report

from ..stage_reports.sessions import circle_session

#: Patience of the client [s], and the simulated time [ns] that passes between two of its looks.
TIMEOUT, TICK = 1.2, 100_000_000


@pytest.mark.usefixtures('ros_env')
def test_lockstep_waits_while_simulated_time_goes_on() -> None:
    place, ticks = np.array([0.01, 0.02]), count(1)
    with SessionClient(0.5, use_sim_time=True) as client:
        encoder, reference = (
            client.node.create_publisher(JointState, topic, STATE_QOS)
            for topic in (topics.JOINT_STATES, topics.REFERENCE)
        )
        for topic in (topics.JOINT_STATES, topics.REFERENCE):
            client.wait_for(lambda t=topic: client.node.count_subscribers(t) > 0, 30.0, topic)

        def tick(ends: bool) -> None:
            stamp = next(ticks) * TICK
            at = place if ends else place + 1e-6 * stamp / TICK
            for publisher in (reference, encoder):
                publisher.publish(joint_state(stamp, ('x', 'y'), position=at.tolist()))

        # Six ticks of half a second each: longer than the patience.
        client.go_to(place, TIMEOUT, lambda: tick(True))
        with pytest.raises(StageError, match='while simulated time stood still for 1 s'):
            client.go_to(place, TIMEOUT, lambda: None)
        with pytest.raises(StageError, match='within 1 s of simulated time') as caught:
            client.go_to(place, TIMEOUT, lambda: tick(False))
    assert '/diagnostics' not in str(caught.value)


@pytest.mark.usefixtures('ros_env')
@pytest.mark.parametrize('lockstep', [True, False])
def test_a_target_is_sent_again_where_nothing_answers_it(
    monkeypatch: pytest.MonkeyPatch, lockstep: bool
) -> None:
    """Simulated time that goes on is an answer; in real time states come anyway."""
    long_ago = time.monotonic() - 2.0 * RESEND
    with SessionClient(0.5, use_sim_time=lockstep) as client:
        monkeypatch.setattr(client, 'silence', lambda topic: 0.1)
        assert (client._unanswered(long_ago) < RESEND) is lockstep
        monkeypatch.setattr(client, 'silence', lambda topic: 2.0 * RESEND)
        assert client._unanswered(long_ago) >= RESEND


def test_a_session_that_fails_says_what_it_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(session, 'refuse_second_graph', lambda names: None)
    monkeypatch.setattr(kernels, 'compile_missing', lambda: False)
    out = tmp_path / 'a session'

    def work(processes: Processes) -> None:
        write_session(out / 'calibration', circle_session())
        (out / 'models').mkdir()
        (out / 'models' / 'first.json').touch()
        raise StageError('the stage did not come to rest')

    assert session.run_graph(Options(out=out), [], work) == 1
    error, saved, told = capsys.readouterr().err.splitlines()
    assert error == 'error: the stage did not come to rest'
    assert saved.startswith(f'saved: calibration, models/first.json in {out}; logs of the nodes')
    words = shlex.split(told.partition(': ')[2])
    assert words[:4] == ['ros2', 'run', 'stage_reports', 'report']
    assert report(words[4:]) == 0
    assert (out / 'report' / 'report.html').is_file()
