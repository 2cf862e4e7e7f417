"""Every node from one command, ended by one Ctrl-C; kernels compiled beforehand."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

from stage_bringup import kernels
from stage_bringup.graph import free_port
from stage_bringup.up import parse
from stage_core.drive_link import DEFAULT_PORT
from stage_core.errors import StageError


def test_every_part_compiles() -> None:
    for compile_part in kernels.PARTS.values():
        compile_part()


def test_the_sentence_does_not_wait_for_what_it_announces() -> None:
    code = 'import sys, stage_bringup.kernels; print(*sys.modules)'
    run = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert not {'numba', 'scipy', 'stage_twin'} & set(run.stdout.split())


def test_what_is_compiled_is_not_compiled_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path))
    assert kernels.marker().parent == tmp_path
    assert not kernels.marker().exists()
    kernels.marker().touch()
    assert kernels.main() == 0
    assert capsys.readouterr().out == ''


def test_real_hardware_takes_the_place_of_the_emulated_one(tmp_path: Path) -> None:
    out = ['--out', str(tmp_path)]
    _, nodes = parse([*out, '--port', '/dev/ttyUSB7', '--tracker', '10.0.0.5'])
    found = {node.name: node.parameters for node in nodes}
    assert 'stage_twin' not in found
    assert found['stage_driver']['backend'] == 'zaber'
    assert found['stage_driver']['port'] == '/dev/ttyUSB7'
    assert (found['tracker_bridge']['host'], found['tracker_bridge']['port']) == ('10.0.0.5', 700)
    _, nodes = parse([*out, '--tracker', '10.0.0.5:7000'])
    found = {node.name: node.parameters for node in nodes}
    assert 'stage_twin' in found
    assert found['tracker_bridge']['port'] == 7000
    _, nodes = parse([*out, '--port', '/dev/ttyUSB7'])
    assert not {'stage_twin', 'tracker_bridge'} & {node.name for node in nodes}
    _, nodes = parse([*out, '--drive', '10.0.0.7:4000', '--tracker', '10.0.0.5'])
    found = {node.name: node.parameters for node in nodes}
    assert 'stage_twin' not in found and found['stage_driver']['backend'] == 'servo'
    address = found['stage_driver']['drive_host'], found['stage_driver']['drive_port']
    assert address == ('10.0.0.7', 4000)
    _, nodes = parse([*out, '--drive', '10.0.0.7'])
    found = {node.name: node.parameters for node in nodes}
    assert found['stage_driver']['drive_port'] == DEFAULT_PORT
    assert not {'stage_twin', 'tracker_bridge'} & set(found)
    with pytest.raises(SystemExit):
        parse([*out, '--drive', '10.0.0.7', '--port', '/dev/ttyUSB7'])
    for wrong in (
        ['--tracker', 'host:port'],
        ['--tracker', ':700'],
        ['--drive', ':20770'],
        ['--port', 'p', '--clock', 'lockstep'],
        ['--port', 'p', '--backend', 'servo'],
        ['--drive', 'host', '--reality', 'machine.yaml'],
    ):
        with pytest.raises(StageError):
            parse([*out, *wrong])


def test_a_model_of_mujoco_is_the_machine(tmp_path: Path) -> None:
    out, rig = ['--out', str(tmp_path)], tmp_path / 'rig.yaml'
    _, nodes = parse([*out, '--model', str(tmp_path / 'stage.xml'), '--nominal', str(rig)])
    twin = next(node for node in nodes if node.name == 'stage_twin').parameters
    assert (twin['engine'], twin['model']) == ('mujoco', tmp_path / 'stage.xml')
    # The other emulated machine's effects would be a second plant.
    assert twin['twin'] == rig
    _, nodes = parse(out)
    assert 'engine' not in next(n for n in nodes if n.name == 'stage_twin').parameters


def test_the_end_of_the_terminal_ends_all(tmp_path: Path, ros_env: dict[str, str]) -> None:
    port = free_port()
    process = subprocess.Popen(
        [sys.executable, '-m', 'stage_bringup.up', '--out', str(tmp_path / 'up')]
        + ['--page-port', str(port)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=ros_env,
        start_new_session=True,
        # Where the tests run under `nohup`, it would be ignored.
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),
    )
    try:
        while True:
            assert process.poll() is None
            try:
                urllib.request.urlopen(f'http://127.0.0.1:{port}/', timeout=5.0).close()
                break
            except OSError:
                time.sleep(0.2)
        nodes = children(process.pid)
        assert len(nodes) >= 8
        os.killpg(process.pid, signal.SIGHUP)  # as a terminal does, to all of its processes
        output, _ = process.communicate()
    finally:
        process.kill()
    assert process.returncode == 0, output
    assert '8 nodes start' in output and 'brought to rest' in output
    # Python's own helper of the process pool ends when it notices that its parent has.
    while any(Path(f'/proc/{pid}').exists() for pid in nodes):
        time.sleep(0.05)


def children(pid: int) -> list[int]:
    found = subprocess.run(
        ['ps', '-o', 'pid=', '--ppid', str(pid)], capture_output=True, text=True
    )
    return [int(word) for word in found.stdout.split()]
