"""Files that are either old or new, whenever the process is killed or the power goes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def replacing(path: str | Path) -> Iterator[BinaryIO]:
    """Stream to write a file with; the file of that name is replaced when all is on the disk.

    A device or a pipe, such as /dev/stdout, is written itself. What raises inside leaves the old
    file; a process that is killed leaves a hidden ``.NAME.PID.part`` beside it.

    Raises
    ------
    OSError
        The folder is not there, is full, or may not be written to.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        with target.open('wb') as stream:
            yield stream
        return
    part = target.with_name(f'.{target.name}.{os.getpid()}.part')
    try:
        with part.open('wb') as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(part, target)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    folder = os.open(target.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def write_whole(path: str | Path, text: str) -> None:
    """Write UTF-8 text with `replacing`."""
    with replacing(path) as stream:
        stream.write(text.encode())
