"""The stand-in's verbs against a small real node, and its pure parts."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

from ros2_standin import install as installer
from ros2_standin.executables import entry_points, find
from ros2_standin.messages import fill, interface, to_plain, to_yaml
from stage_core.errors import StageError

pytest.importorskip('rclpy')

Result = 'subprocess.CompletedProcess[str]'

#: A node with a latched topic, a fast topic, a service and parameters.
NODE = """
import rclpy
from std_msgs.msg import Float64
from std_srvs.srv import SetBool
from rcl_interfaces.msg import SetParametersResult
rclpy.init()
node = rclpy.create_node('small', namespace='lab')
node.declare_parameter('gain', 0.5)
node.declare_parameter('group.label', 'one')
node.add_on_set_parameters_callback(
    lambda changes: SetParametersResult(
        successful=all(c.name != 'gain' or c.value >= 0 for c in changes), reason='gain < 0'))
publisher = node.create_publisher(Float64, 'value', 10)
node.create_timer(0.02, lambda: publisher.publish(Float64(data=2.5)))
def answer(request, response):
    response.success, response.message = request.data, 'heard'
    return response
node.create_service(SetBool, '~/flag', answer)
print('ready', flush=True)
rclpy.spin(node)
"""


@pytest.fixture
def small_node(ros_env: dict[str, str]) -> Iterator[None]:
    process = subprocess.Popen(
        [sys.executable, '-c', NODE], env=ros_env, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == 'ready\n'
    yield
    process.kill()
    process.communicate()


@pytest.fixture
def ros2_together(ros_env: dict[str, str]) -> Callable[..., list[tuple[int, str, str]]]:
    """Run several verbs at once: each spends its time waiting for discovery."""

    def run(*lines: tuple[str, ...]) -> list[tuple[int, str, str]]:
        processes = [
            subprocess.Popen(
                [sys.executable, '-m', 'ros2_standin', *words],
                env=ros_env,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            for words in lines
        ]
        results = []
        for process in processes:
            out, err = process.communicate()
            results.append((process.returncode, out, err))
        return results

    return run


@pytest.mark.usefixtures('small_node')
def test_graph_verbs(ros2_together: Callable[..., list[tuple[int, str, str]]]) -> None:
    echoed, called, listed, done, refused = ros2_together(
        ('topic', 'echo', '/lab/value', '--once'),
        ('service', 'call', '/lab/small/flag', 'std_srvs/srv/SetBool', '{data: true}'),
        ('param', 'list', '/lab/small'),
        ('param', 'set', 'lab/small', 'group.label', 'two'),
        ('param', 'set', '/lab/small', 'gain', '-1.0'),
    )
    assert yaml.safe_load(echoed[1].split('---')[0]) == {'data': 2.5}
    assert called[1].splitlines()[-2:] == [
        "std_srvs.srv.SetBool_Response(success=True, message='heard')",
        '',
    ]
    assert '  gain\n  group.label\n' in listed[1]
    assert done[:2] == (0, 'Set parameter successful\n')
    assert refused[0] == 2 and 'gain < 0' in refused[2]


@pytest.mark.usefixtures('small_node')
def test_rate_of_a_topic(ros_env: dict[str, str]) -> None:
    words = [sys.executable, '-m', 'ros2_standin', 'topic', 'hz', '/lab/value']
    process = subprocess.Popen(
        words, env={**ros_env, 'PYTHONUNBUFFERED': '1'}, stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        first = process.stdout.readline()
        assert first.startswith('average rate: ') and float(first.split()[-1]) > 0
        assert process.stdout.readline().lstrip().startswith('min: ')
        process.send_signal(signal.SIGINT)
        assert process.wait() == 130
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def test_run(ros2_together: Callable[..., list[tuple[int, str, str]]]) -> None:
    run, *refused = ros2_together(
        ('run', 'session_bags', 'check', '--help'),
        ('run', 'nowhere', 'x'),
        ('run', 'session_bags', 'x'),
        ('launch', 'stage_bringup', 'session.launch.py'),
    )
    assert run[0] == 0 and run[1].startswith('usage: check')
    texts = ("Package 'nowhere' not found", 'No executable found', 'stage_bringup up')
    for (code, _, err), text in zip(refused, texts, strict=True):
        assert code == 2 and text in err
        assert 'Traceback' not in err


def test_every_declared_executable_can_be_found() -> None:
    points = entry_points()
    assert 'session_recorder' in points['session_bags'] and 'report' in points['stage_reports']
    for package, names in points.items():
        for name, entry in names.items():
            line, _ = find(package, name, 'python')
            assert line[0] == 'python' and entry.split(':')[0] in line[-1]


@pytest.mark.skipif(shutil.which('make') is None, reason='no make on PATH')
def test_nodes_load_the_kernels_that_make_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv('NUMBA_CACHE_DIR', raising=False)
    show = [
        'make',
        '-s',
        '--no-print-directory',
        '--eval',
        'show:;@echo $(NUMBA_CACHE_DIR)',
        'show',
    ]
    root = Path(__file__).resolve().parents[2]
    made = subprocess.run(show, cwd=root, capture_output=True, text=True, check=True).stdout
    assert find('stage_driver', 'stage_driver', '')[1]['NUMBA_CACHE_DIR'] == made.strip()
    monkeypatch.setenv('NUMBA_CACHE_DIR', 'chosen')
    assert find('stage_driver', 'stage_driver', '')[1]['NUMBA_CACHE_DIR'] == 'chosen'


def test_an_installed_workspace_wins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = tmp_path / 'lib' / 'session_bags' / 'check'
    script.parent.mkdir(parents=True)
    script.write_text('#!/bin/sh\n')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    assert find('session_bags', 'check', 'python')[0][0] == 'python'
    script.chmod(0o755)
    assert find('session_bags', 'check', 'python')[0] == [str(script)]


def test_steps_aside_for_a_real_ros2(tmp_path: Path) -> None:
    real = tmp_path / 'ros2'
    real.write_text('#!/bin/sh\necho the real one: "$@"\n')
    real.chmod(0o755)
    first = {**os.environ, 'PATH': f'{tmp_path}:{os.environ["PATH"]}'}
    words = [sys.executable, '-m', 'ros2_standin', 'topic', 'list']
    shown = subprocess.run(words, env=first, capture_output=True, text=True)
    assert shown.stdout == 'the real one: topic list\n'


def test_install_writes_and_removes_the_launcher(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own, other = tmp_path / 'own', tmp_path / 'other'
    monkeypatch.setenv('PATH', str(own))
    assert installer.install(own) == own / 'ros2'
    assert installer.real_ros2() is None, 'the launcher is not taken for the real one'
    shown = subprocess.run([own / 'ros2', 'run', '--help'], capture_output=True, text=True)
    assert 'usage: ros2 run' in shown.stdout
    other.mkdir()
    (other / 'ros2').write_text('#!/bin/sh\n')
    (other / 'ros2').chmod(0o755)
    monkeypatch.setenv('PATH', f'{own}{os.pathsep}{other}')
    assert installer.install(own) is None and not (own / 'ros2').exists()
    with pytest.raises(StageError, match='not of this workspace'):
        installer.install(other)


def test_messages_from_yaml_and_back() -> None:
    state = fill(
        interface('sensor_msgs/JointState', 'msg')(),
        'header: {frame_id: stage, stamp: {sec: 3, nanosec: 4}}\nname: [x]\nposition: [1]\n',
    )
    assert list(state.position) == [1.0] and state.header.stamp.sec == 3
    assert yaml.safe_load(to_yaml(state)) == to_plain(state)


@pytest.mark.parametrize(
    ('type_name', 'text', 'wrong'),
    [
        ('std_srvs/srv/SetBool', '{data: [1]}', 'data is a boolean'),
        ('std_srvs/srv/SetBool', '{datum: true}', 'has no field datum'),
        ('std_srvs/srv/SetBool', '{data: ', 'not valid YAML'),
        ('std_srvs/srv/SetBool', '3', 'dictionary'),
    ],
)
def test_bad_values_are_named(type_name: str, text: str, wrong: str) -> None:
    with pytest.raises(StageError, match=wrong):
        fill(interface(type_name, 'srv').Request(), text)


def test_unknown_types_are_named() -> None:
    with pytest.raises(StageError, match='nothing_msgs/msg/Odd'):
        interface('nothing_msgs/msg/Odd', 'msg')


def test_rate_report_of_a_steady_topic() -> None:
    from ros2_standin.graph_node import rate_report

    lines = rate_report([0.5 * k for k in range(5)]).split('\n')
    assert lines[0] == 'average rate: 2.000'
    assert lines[1] == '\tmin: 0.500s max: 0.500s std dev: 0.00000s window: 4'
