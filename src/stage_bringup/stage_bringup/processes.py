"""The nodes as processes: started with their logs, watched, ended by pid."""

from __future__ import annotations

import ctypes
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from stage_core.errors import StageError
from stage_core.signals import ending

_SETUP = """
import sys
from {module} import main
sys.exit(main())
"""
_PR_SET_PDEATHSIG = 1


def die_with_parent() -> None:
    """In a child: end with the process that started it, even where that one is killed."""
    # A session that is killed must leave no node behind; Linux only, elsewhere nodes end by hand.
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


@contextmanager
def _deaf() -> Iterator[None]:
    """What ends a process waits: Python drops what is raised while a process forks."""
    # Blocking them would not do: another thread takes the signal, the handler runs in this one.
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heard: list[int] = []
    before = {int(n): signal.getsignal(n) for n in ending()}
    handlers = {number: handler for number, handler in before.items() if callable(handler)}
    for number in handlers:
        signal.signal(number, lambda number, _: heard.append(number))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number in heard:
            signal.raise_signal(number)


@dataclass(frozen=True)
class NodeCommand:
    """One process: its name, the module with its ``main``, its nodes' parameters and files."""

    name: str
    module: str
    parameters: Mapping[str, object]
    parameter_files: tuple[Path, ...] = ()

    def arguments(self) -> list[str]:
        """Command line of the process."""
        line = [sys.executable, '-c', _SETUP.format(module=self.module), '--ros-args']
        for path in self.parameter_files:
            line += ['--params-file', str(path)]
        for name, value in self.parameters.items():
            # ROS reads the value as YAML, of which JSON is a part: a text may hold anything.
            line += ['-p', f'{name}:={json.dumps(value, ensure_ascii=False, default=str)}']
        return line


class Processes:
    """Processes of the graph, with one log file each in `log_folder`.

    `interrupted` raises where an interrupt came; it is asked at each start and each check.
    """

    def __init__(self, log_folder: Path, interrupted: Callable[[], None] = lambda: None) -> None:
        self.log_folder = log_folder
        self._interrupted = interrupted
        log_folder.mkdir(parents=True, exist_ok=True)
        self.running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, command: NodeCommand) -> None:
        """Start one node; its output goes to ``<name>.log``."""
        self._interrupted()
        with open(self.log_folder / f'{command.name}.log', 'ab') as log, _deaf():
            self.running[command.name] = subprocess.Popen(
                command.arguments(),
                stdout=log,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                env=os.environ.copy(),
                preexec_fn=die_with_parent if sys.platform == 'linux' else None,
            )

    def check(self) -> None:
        """Check that every node still runs.

        Raises
        ------
        StageError
            With the last line that the ended node wrote.
        """
        self._interrupted()
        for name, process in self.running.items():
            status = process.poll()
            if status is not None:
                raise StageError(
                    f'{name} ended with status {status}: {self.last_line(name)} '
                    f'(whole log: {self.log_folder / name}.log)'
                )

    def last_line(self, name: str) -> str:
        """The last line of a node's log."""
        path = self.log_folder / f'{name}.log'
        lines = path.read_text(errors='replace').split('\n') if path.exists() else []
        return next((line.strip() for line in reversed(lines) if line.strip()), 'no output')

    def end(self, patience: float = 20.0) -> list[str]:
        """End every node, the newest first: SIGTERM, then SIGKILL after `patience` [s].

        Returns the names of those that had to be killed.
        """
        names = list(reversed(self.running))
        killed = []
        # One after the other: the plant was started first and must outlive its driver.
        for name in names:
            process = self.running[name]
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
            deadline = time.monotonic() + patience
            while process.poll() is None and time.monotonic() < deadline:
                time.sleep(0.02)
            if process.poll() is None:
                process.kill()
                process.wait()
                killed.append(name)
        self.running.clear()
        return killed
