"""An interrupt ends a session with its own exit status, also where what it raised got lost."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

#: A graph of one node, which sleeps, and a work that loses its Ctrl-C in a finalizer.
GRAPH = """
import os, signal, sys
from pathlib import Path
from types import SimpleNamespace
from stage_bringup import kernels, session
from stage_bringup.processes import NodeCommand, Processes
from stage_core.errors import StageError

session.refuse_second_graph = lambda names: None
kernels.compile_missing = lambda: False
folder = Path(sys.argv[1])
(folder / 'sleeper.py').write_text('import time\\ndef main(): time.sleep(600)')
os.environ['PYTHONPATH'] = os.pathsep.join([str(folder), *(p for p in sys.path if p)])
begun, end = [], Processes.end

class Loser:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)

def ends(processes):
    begun.extend(processes.running.values())
    {at_end}
    return end(processes)

def work(processes):
    {works}

Processes.end = ends
node = NodeCommand('sleeper', 'sleeper', {{}})
status = session.run_graph(SimpleNamespace(out=folder / 'out'), [node], work)
print(status, [process.poll() for process in begun])
"""


def run(folder: Path, works: str, at_end: str = 'pass') -> subprocess.CompletedProcess[str]:
    code = GRAPH.format(works=works, at_end=at_end)
    return subprocess.run(
        [sys.executable, '-c', code, str(folder)], capture_output=True, text=True
    )


@pytest.mark.parametrize(
    'after',
    ['pass', 'processes.check(); print("goes on")', 'raise ImportError', 'raise StageError("x")'],
)
def test_a_lost_interrupt_ends_the_session(tmp_path: Path, after: str) -> None:
    done = run(tmp_path, f'Loser(); {after}')
    assert done.stdout == '130 [-15]\n', done.stderr
    assert 'Exception ignored' in done.stderr and 'interrupted: ' in done.stderr


def test_an_interrupt_does_not_stop_the_end_of_the_nodes(tmp_path: Path) -> None:
    done = run(tmp_path, 'pass', at_end='os.kill(os.getpid(), signal.SIGINT)')
    assert done.stdout == '130 [-15]\n', done.stderr


def test_an_error_without_an_interrupt_is_not_hidden(tmp_path: Path) -> None:
    done = run(tmp_path, 'raise ImportError')
    assert done.returncode == 1 and 'ImportError' in done.stderr


def test_ctrl_c_while_the_compilers_start_is_heard() -> None:
    code = (
        'import os, signal\n'
        'from stage_bringup.kernels import _deaf_to_ctrl_c\n'
        'try:\n'
        '    with _deaf_to_ctrl_c(): os.kill(os.getpid(), signal.SIGINT); print("started")\n'
        'except KeyboardInterrupt: print("heard")\n'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert done.stdout == 'started\nheard\n', done.stderr


def test_ctrl_c_inside_an_exec_leaves_the_exit_status_to_the_command(tmp_path: Path) -> None:
    # A dataclass that is being imported is such an exec.
    (tmp_path / 'interrupted.py').write_text(
        'import os, signal, sys\n'
        'from stage_bringup.interrupts import Interrupts\n'
        'Interrupts()\n'
        'try: exec("os.kill(os.getpid(), signal.SIGINT)")\n'
        'except KeyboardInterrupt: sys.exit(130)\n'
    )
    ended = subprocess.run([sys.executable, '-m', 'interrupted'], check=False, cwd=tmp_path)
    assert ended.returncode == 130
