"""A wire has one owner on this machine: a lock file, given back with the end of the process."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import socket
import time
from pathlib import Path
from typing import IO

from stage_core.errors import StageError

#: The same for every terminal, whatever its TMPDIR.
FOLDER = Path('/tmp')


class Ownership:
    """Holds a wire until `close` or the end of the process.

    Parameters
    ----------
    wire
        What is held, the same words for everybody: ``drive 127.0.0.1:20770``.
    holder
        Who holds it, for whoever comes second: ``stage_driver``.
    remedy
        What the second one may do instead of stopping the first.

    Raises
    ------
    StageError
        If another process holds it, or this one does already: with its name, pid and since when.
    """

    def __init__(self, wire: str, holder: str, remedy: str) -> None:
        name = hashlib.sha256(wire.encode()).hexdigest()[:16]
        path = FOLDER / f'stage_owner_{name}.lock'
        self._file = _open(path)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            first = os.pread(self._file, 200, 0).decode(errors='replace').strip()
            os.close(self._file)
            raise StageError(
                f'{first or "another process"} holds the {wire}: stop it, or {remedy}'
            ) from error
        with contextlib.suppress(OSError):
            # Another user's file can be locked, and not written.
            since = time.strftime('%H:%M')
            text = f'{holder} with pid {os.getpid()} (since {since})'
            os.ftruncate(self._file, 0)
            os.pwrite(self._file, text.encode(), 0)

    def close(self) -> None:
        """Give it back."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def hold(file: IO[bytes]) -> bool:
    """Lock an open file until it is closed; False where somebody else holds it.

    Where the file system knows no locks nobody is known to hold it.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def _open(path: Path) -> int:
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        with contextlib.suppress(OSError):
            # The umask has taken the others' right to write.
            os.chmod(path, 0o666)
        return file
    except PermissionError:
        return os.open(path, os.O_RDONLY)


def address(host: str, port: int) -> str:
    """Host and port in the same words, however the host was named."""
    with contextlib.suppress(OSError):
        host = socket.gethostbyname(host)
    return f'{host}:{port}'
