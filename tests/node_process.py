"""A node of the workspace as a process that ends with its block."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .patience import PATIENCE


def start(
    module: str, env: Mapping[str, str], *files: Path, **parameters: Any
) -> subprocess.Popen[str]:
    """Run a module's node with parameter files and parameters (`x__gain` is `x.gain`)."""
    command = [sys.executable, '-m', module, '--ros-args']
    command += [word for path in files for word in ('--params-file', str(path))]
    for name, value in parameters.items():
        command += ['-p', f'{name.replace("__", ".")}:={value}']
    return subprocess.Popen(
        command, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


def end(process: subprocess.Popen[str]) -> str:
    """End a node that has not ended by itself; what it has said."""
    if process.poll() is None:
        process.terminate()
    try:
        return process.communicate(timeout=PATIENCE)[0]
    except subprocess.TimeoutExpired:
        process.kill()
        return process.communicate()[0]


@contextmanager
def node(
    module: str, env: Mapping[str, str], *files: Path, **parameters: Any
) -> Iterator[subprocess.Popen[str]]:
    """A node that ends with the block; a failing test shows what it has said."""
    process = start(module, env, *files, **parameters)
    try:
        yield process
    finally:
        print(end(process))
