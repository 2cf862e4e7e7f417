"""Computations in the background yield the processor."""

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
