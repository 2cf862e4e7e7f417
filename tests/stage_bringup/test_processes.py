"""Processes of the graph: an interrupt is heard whenever it comes; ports are their own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from socket import SOCK_DGRAM, SOCK_STREAM

import pytest
import yaml

from stage_bringup.graph import free_port
from stage_bringup.processes import NodeCommand

#: Sends itself Ctrl-C in the middle of the fork of a node, which sleeps; a second thread, like
#: those of DDS, would take the signal from a first one that blocks it.
STARTS = """
import os, signal, sys, threading
from pathlib import Path
from stage_bringup.processes import NodeCommand, Processes

threading.Thread(target=threading.Event().wait, daemon=True).start()
os.register_at_fork(after_in_parent=lambda: os.kill(os.getpid(), signal.SIGINT))
folder = Path(sys.argv[1])
(folder / 'sleeper.py').write_text('import time\\ndef main(): time.sleep(600)')
sys.path.insert(0, str(folder))
os.environ['PYTHONPATH'] = os.pathsep.join(p for p in sys.path if p)
graph = Processes(folder / 'log')
try:
    graph.start(NodeCommand('sleeper', 'sleeper', {}))
    print('deaf')
except KeyboardInterrupt:
    print('heard', len(graph.running), graph.end())
"""


def test_ctrl_c_while_a_node_is_started_is_heard(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, '-c', STARTS, str(tmp_path)], capture_output=True, text=True
    )
    # The node is known, and ends at SIGTERM as any other.
    assert done.stdout == 'heard 1 []\n', done.stderr


def test_a_free_port_is_none_of_those_that_dds_gives_to_nodes() -> None:
    # Participant p of domain d listens at 7400 + 250 d + 10 + 2 p and at the port after it.
    first = [7400 + 250 * d + 10 + 2 * p for d in range(233) for p in range(40)]
    theirs = {*first, *(port + 1 for port in first)}
    drawn = {free_port(kind) for kind in (SOCK_DGRAM, SOCK_STREAM) for _ in range(300)}
    assert len(drawn) > 300 and not drawn & theirs


@pytest.mark.parametrize('value', ['run #2', 'My Projects/ä "b"', '5', 'true', '', 0.25, True, 3])
def test_a_parameter_arrives_as_it_was_given(value: object) -> None:
    *_, given = NodeCommand('node', 'module', {'out': value}).arguments()
    arrived = yaml.safe_load(given.removeprefix('out:='))
    assert arrived == value and type(arrived) is type(value)
