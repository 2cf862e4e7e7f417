"""What keeps the processors awake gives way to all else, and ends with who asked for it."""

import os
import signal
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from stage_bringup import keep_awake
from stage_bringup.keep_awake import KeepAwake, main

from ..patience import wait

pytestmark = pytest.mark.skipif(not hasattr(os, 'SCHED_IDLE'), reason='needs SCHED_IDLE')


def state(pid):
    """Processors of a process once it is at work: one, with the lowest policy."""
    wait(
        lambda: (
            os.sched_getscheduler(pid) == os.SCHED_IDLE and len(os.sched_getaffinity(pid)) == 1
        ),
        f'process {pid} never became idle',
    )
    return os.sched_getaffinity(pid)


def text_of(pid, name):
    """A file of /proc; empty once the process is gone."""
    try:
        return Path(f'/proc/{pid}/{name}').read_text()
    except (FileNotFoundError, ProcessLookupError):
        return ''


def ended(pid):
    """Whether a process is gone, or is a zombie, which nobody may ever fetch."""
    return text_of(pid, 'stat').rpartition(')')[2].split()[:1] in ([], ['Z'])


def wait_for_end(pid):
    wait(lambda: ended(pid), f'process {pid} is still there')


def test_without_an_idle_driver_each_processor_has_a_process_of_the_lowest_kind(tmp_path):
    driver = tmp_path / 'current_driver'
    driver.write_text('none\n')
    with KeepAwake(tmp_path / 'latency', driver) as awake:
        pids = awake.pids
        assert awake.how == f'{len(pids)} processes under SCHED_IDLE'
        assert {tuple(state(pid)) for pid in pids} == {(p,) for p in os.sched_getaffinity(0)}
        if os.path.exists('/proc/self/autogroup'):
            # Without, a session of its own has the weight of any other: half of the processors.
            for pid in pids:
                weight = f'the session of {pid} keeps its weight'
                wait(lambda pid=pid: text_of(pid, 'autogroup').endswith('nice 19\n'), weight)
    assert awake.pids == []
    for pid in pids:
        wait_for_end(pid)


def test_where_the_kernel_has_an_idle_driver_it_is_asked(tmp_path):
    driver, latency = tmp_path / 'current_driver', tmp_path / 'latency'
    driver.write_text('intel_idle\n')
    latency.touch()
    with KeepAwake(latency, driver) as awake:
        assert awake.pids == [] and str(latency) in awake.how
        # The kernel listens as long as the file is open.
        assert str(latency) in {
            os.path.realpath(f'/proc/self/fd/{fd}') for fd in os.listdir('/proc/self/fd')
        }
        assert latency.read_bytes() == struct.pack('i', 0)
    assert str(latency) not in {
        os.path.realpath(f'/proc/self/fd/{fd}') for fd in os.listdir('/proc/self/fd')
    }


def test_a_kernel_that_refuses_is_no_obstacle(tmp_path):
    driver = tmp_path / 'current_driver'
    driver.write_text('acpi_idle\n')
    with KeepAwake(tmp_path / 'no folder' / 'latency', driver) as awake:
        assert len(awake.pids) == len(os.sched_getaffinity(0))


def test_another_system_is_told_and_not_stopped(tmp_path, monkeypatch, capsys):
    monkeypatch.delattr(os, 'SCHED_IDLE')
    with KeepAwake(tmp_path / 'latency', tmp_path / 'current_driver') as awake:
        assert (awake.how, awake.pids) == ('', [])
    monkeypatch.setattr(KeepAwake, '_kernel_agrees', lambda _: False)
    monkeypatch.setattr(signal, 'signal', lambda *_: None)
    assert main([]) == 2
    assert 'keep_awake needs Linux' in capsys.readouterr().err


def test_nothing_starts_it_by_itself():
    packages = Path(keep_awake.__file__).resolve().parents[2]
    users = [p.name for p in packages.glob('*/*/*.py') if 'KeepAwake' in p.read_text()]
    assert users == ['keep_awake.py']


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_the_command_leaves_nothing_behind_however_it_ends(number):
    process = subprocess.Popen(
        [sys.executable, '-m', 'stage_bringup.keep_awake'], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout.readline().startswith('the processors stay awake: ')
        with open(f'/proc/{process.pid}/task/{process.pid}/children') as text:
            children = text.read().split()
        process.send_signal(number)
        status = process.wait()
    finally:
        process.kill()
        process.communicate()
    assert status == (-signal.SIGKILL if number == signal.SIGKILL else 0)
    for pid in children:
        wait_for_end(pid)
