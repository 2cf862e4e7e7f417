"""Processes of the graph: an interrupt is heard whenever it comes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

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
