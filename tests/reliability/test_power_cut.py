"""The tests of `power_cut.py` in a process of their own.

They fork. A child of a process in which other tests left threads may wait for ever for a lock
that one of them held.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def test_killed_at_each_write() -> None:
    tests = Path(__file__).with_name('power_cut.py')
    run = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-x', str(tests)],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
    )
    assert run.returncode == 0, run.stdout + run.stderr
