"""A node of the workspace as a process that ends with its block."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager


@contextmanager
def node(module: str, env: Mapping[str, str], *parameters: str) -> Iterator[subprocess.Popen[str]]:
    """Run a module's node with `name:=value` parameters; its output is one pipe."""
    arguments = [item for pair in parameters for item in ('-p', pair)]
    process = subprocess.Popen(
        [sys.executable, '-m', module, '--ros-args', *arguments],
        env=env,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(20.0)
            except subprocess.TimeoutExpired:
                process.kill()
        process.communicate()
