"""Finding a real ros2 command, to step aside for."""

from __future__ import annotations

import os
from pathlib import Path

#: Word in a launcher written by :mod:`ros2_standin.install`.
MARK = b'ros2_standin'


def real_ros2(search_path: str | None = None) -> Path | None:
    """First ``ros2`` on PATH that is not a launcher of this package; None where there is none."""
    folders = (os.environ.get('PATH', '') if search_path is None else search_path).split(
        os.pathsep
    )
    for folder in folders:
        candidate = Path(folder or '.') / 'ros2'
        if candidate.is_file() and os.access(candidate, os.X_OK) and not _is_launcher(candidate):
            return candidate
    return None


def _is_launcher(path: Path) -> bool:
    with open(path, 'rb') as stream:
        return MARK in stream.read(4096)
