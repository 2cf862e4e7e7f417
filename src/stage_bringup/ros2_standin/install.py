"""``python -m ros2_standin.install BIN``: put the ``ros2`` launcher into a folder on PATH."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from stage_core.errors import StageError, command_line
from stage_core.whole_file import write_whole

_LAUNCHER = """#!/bin/sh
# Launcher of ros2_standin: the ros2 verbs where ros2cli is not installed.
exec "{python}" -m ros2_standin "$@"
"""


#: Word in a launcher that was written here.
MARK = b'ros2_standin'


def real_ros2() -> Path | None:
    """First ``ros2`` on PATH that is not a launcher of this package; None where there is none."""
    for folder in os.environ.get('PATH', '').split(os.pathsep):
        candidate = Path(folder or '.') / 'ros2'
        if candidate.is_file() and os.access(candidate, os.X_OK) and not _is_launcher(candidate):
            return candidate
    return None


def _is_launcher(path: Path) -> bool:
    return path.is_file() and MARK in path.read_bytes()[:4096]


def install(folder: Path) -> Path | None:
    """Write the launcher; None where a real ``ros2`` is on PATH (an old launcher is removed).

    Raises
    ------
    StageError
        If the folder cannot be written to, or holds a ``ros2`` of somebody else.
    """
    target = folder / 'ros2'
    if target.exists() and not _is_launcher(target):
        raise StageError(
            f'{target} is not of this workspace: the real ros2 is used, nothing to do'
        )
    try:
        if real_ros2() is not None:
            target.unlink(missing_ok=True)
            return None
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(target, _LAUNCHER.format(python=sys.executable))
        target.chmod(0o755)
    except OSError as error:
        raise StageError(
            f'cannot write {target} ({error.strerror}): name another folder'
        ) from error
    return target


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Install the launcher into the named folder."""
    parser = argparse.ArgumentParser(prog='python -m ros2_standin.install', description=__doc__)
    parser.add_argument('folder', type=Path, help='folder on PATH, as .venv/bin')
    written = install(parser.parse_args(arguments).folder)
    print(f'ros2: {written}' if written else f'ros2: the real one at {real_ros2()} is used')
    return 0


if __name__ == '__main__':
    sys.exit(main())
