"""The base of the nodes, in a process of its own."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import String

from stage_core.errors import StageError
from stage_core.ros.client_node import GraphClient
from stage_core.ros.parameter_files import check_files, refuse_misspelt

from ..patience import PATIENCE

NODE = """
import sys
from std_srvs.srv import Trigger
from stage_core.parameters import Parameter
from stage_core.ros.node import OK, StageNode, run

class Tester(StageNode):
    def __init__(self):
        super().__init__('tester', [Parameter('feed', 1.0, 'feed', 'm/s', 0.0, 2.0)])
        self.create_service(Trigger, '~/feed', self.feed)
        self.diagnostics.task('feed', lambda: (OK, 'fine', {'feed': self.value('feed')}))

    def feed(self, request, response):
        response.success, response.message = True, str(self.value('feed'))
        return response

    def shutdown(self):
        print('at rest', flush=True)

sys.exit(run(Tester))
"""


@pytest.fixture
def script(tmp_path: Path) -> Path:
    path = tmp_path / 'tester.py'
    path.write_text(NODE)
    return path


@pytest.fixture
def tester(script: Path, ros_env: dict[str, str]) -> Iterator[subprocess.Popen]:
    process = subprocess.Popen(
        [sys.executable, str(script), '--ros-args', '-p', 'feed:=1'],
        stdout=subprocess.PIPE,
        text=True,
        env=ros_env,
    )
    yield process
    process.kill()
    process.wait()


def test_parameters_diagnostics_and_end(tester: subprocess.Popen) -> None:
    with GraphClient('judge') as client:
        client.watch(DiagnosticArray, '/diagnostics')
        assert client.trigger('/tester/feed', PATIENCE) == '1.0'
        client.set_parameters('/tester', feed=1.5)
        assert client.trigger('/tester/feed', PATIENCE) == '1.5'
        with pytest.raises(StageError, match='feed'):
            client.set_parameters('/tester', feed=3.0)
        with pytest.raises(StageError, match='no parameter fed: did you mean feed'):
            client.set_parameters('/tester', fed=1.0)
        with pytest.raises(StageError, match='absent'):
            client.trigger('/nobody/home', 0.5)
        client.wait_for(lambda: client.latest('/diagnostics') is not None, PATIENCE, 'diagnostics')
        names = [status.name for status in client.latest('/diagnostics').status]
        assert names == ['tester: peers', 'tester: feed']
    tester.terminate()
    output, _ = tester.communicate()
    assert tester.returncode == 0
    assert 'at rest' in output


def test_a_condition_may_call_services_while_messages_come(tester: subprocess.Popen) -> None:
    ended = threading.Event()
    with GraphClient('judge') as client:
        client.watch(String, '/busy')
        publisher = client.node.create_publisher(String, '/busy', 10)

        def flood() -> None:
            while not ended.is_set():
                publisher.publish(String(data='x'))
                time.sleep(0.001)

        flooding = threading.Thread(target=flood)
        flooding.start()
        try:
            client.wait_for(lambda: client.latest('/busy') is not None, PATIENCE, 'the flood')
            client.trigger('/tester/feed', PATIENCE)
            answers: list[str] = []

            def ten_answers() -> bool:
                answers.append(client.trigger('/tester/feed', PATIENCE))
                return len(answers) == 10

            client.wait_for(ten_answers, PATIENCE, 'ten answers')
        finally:
            ended.set()
            flooding.join()


def test_a_second_node_of_the_same_name_is_named(
    script: Path, tester: subprocess.Popen, ros_env: dict[str, str]
) -> None:
    second = subprocess.Popen(
        [sys.executable, str(script)], stderr=subprocess.PIPE, text=True, env=ros_env
    )
    told: list[str] = []

    def quarrel() -> bool:
        return any('two tester speak' in text for text in told)

    try:
        with GraphClient('judge') as client:
            client.watch(
                DiagnosticArray,
                '/diagnostics',
                callback=lambda array: told.extend(status.message for status in array.status),
            )
            client.wait_for(quarrel, PATIENCE, 'the word of two nodes')
            text = next(text for text in told if 'two tester' in text)
            assert f'pid {tester.pid} on' in text and f'pid {second.pid} on' in text
    finally:
        second.terminate()
        _, errors = second.communicate()
    assert 'end one graph, or give it another ROS_DOMAIN_ID' in errors


def test_a_parameter_file_is_checked_whole(tmp_path: Path) -> None:
    path = tmp_path / 'file.yaml'
    arguments = ['node', '--ros-args', '--params-file', str(path)]
    with pytest.raises(StageError, match=r'cannot read parameter file .*No such file'):
        check_files(arguments)
    for text, words in (('tester: [', 'not valid YAML'), ('tester: {feed: 1}', 'ros__parameters')):
        path.write_text(text)
        with pytest.raises(StageError, match=words):
            check_files(arguments)
    path.write_text('testr: {ros__parameters: {feed: 1}}')
    check_files(arguments)
    with pytest.raises(StageError, match='section testr and none for tester'):
        refuse_misspelt(arguments, 'tester')
    for name in ('/**', '/ns/tester', 'somebody_else'):
        path.write_text(f'{name}: {{ros__parameters: {{feed: 1}}}}')
        refuse_misspelt(arguments, 'tester')


@pytest.mark.parametrize(
    ('override', 'words'), [('feed:=5.0', '0.0 ... 2.0'), ('fed:=1.0', 'no parameter fed')]
)
def test_bad_parameter_is_one_line(
    script: Path, ros_env: dict[str, str], override: str, words: str
) -> None:
    done = subprocess.run(
        [sys.executable, str(script), '--ros-args', '-p', override],
        capture_output=True,
        text=True,
        env=ros_env,
    )
    assert done.returncode == 2
    assert done.stderr.count('\n') == 1 and words in done.stderr
