"""Computations in the background yield the processor; what controls the stage takes it."""

import os
import subprocess
import sys

import pytest

from stage_core.priority import BACKGROUND, to_background


@pytest.mark.skipif(not hasattr(os, 'getpriority'), reason='no priorities here')
@pytest.mark.parametrize('niceness', [0, BACKGROUND + 5])
def test_priority_is_lowered_and_never_raised(niceness):
    waits = [sys.executable, '-c', 'import sys; sys.stdin.read()']
    process = subprocess.Popen(waits, stdin=subprocess.PIPE)
    try:
        before = max(niceness, os.getpriority(os.PRIO_PROCESS, process.pid))
        os.setpriority(os.PRIO_PROCESS, process.pid, before)
        to_background(process.pid)
        after = os.getpriority(os.PRIO_PROCESS, process.pid)
        assert after == max(before, BACKGROUND)
    finally:
        process.communicate()


SCRIPT = """
import os, resource, subprocess, sys, threading
priority, refused = int(sys.argv[1]), sys.argv[2] == 'refused'
from stage_core.priority import to_real_time

ended = threading.Event()
early = threading.Thread(target=ended.wait)
early.start()
if refused:
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
    os.setuid(65534)
print(to_real_time(priority))
late = threading.Thread(target=ended.wait)
late.start()
kind = lambda thread: os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
policies = [kind(0), kind(early.native_id), kind(late.native_id)]
ended.set()
if not refused:
    child = 'import os; print(os.sched_getscheduler(0))'
    done = subprocess.run([sys.executable, '-c', child], capture_output=True)
    policies.append(int(done.stdout))
print(*policies)
"""


def outcome(priority: int, permission: str = 'as it is') -> tuple[str, list[int]]:
    done = subprocess.run(
        [sys.executable, '-c', SCRIPT, str(priority), permission],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    words, policies = done.stdout.splitlines()
    return words, [int(policy) for policy in policies.split()]


def test_zero_is_ordinary() -> None:
    assert outcome(0) == ('ordinary', [os.SCHED_OTHER] * 4)


def test_every_thread_gets_it_and_no_child_process() -> None:
    words, policies = outcome(7)
    if 'refused' in words:
        pytest.skip(f'not permitted here: {words}')
    assert words == 'SCHED_FIFO 7'
    assert policies == [os.SCHED_FIFO, os.SCHED_FIFO, os.SCHED_OTHER, os.SCHED_OTHER]


@pytest.mark.skipif(os.geteuid() != 0, reason='only root can become a user without permission')
def test_without_permission_it_says_so_and_goes_on() -> None:
    words, policies = outcome(7, 'refused')
    assert words == 'ordinary: SCHED_FIFO 7 was refused (Operation not permitted)'
    assert policies == [os.SCHED_OTHER] * 3
