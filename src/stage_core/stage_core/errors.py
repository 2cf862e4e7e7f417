"""The one error that a user sees, and how a command line shows it."""

from __future__ import annotations

import errno
import functools
import sys
from collections.abc import Callable
from typing import ParamSpec

Arguments = ParamSpec('Arguments')

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130
#: What to do about a disk that takes nothing.
DISK_REFUSES = {
    errno.ENOSPC: 'make room and run it again',
    errno.EDQUOT: 'make room and run it again',
    errno.EROFS: 'give another folder',
    errno.EACCES: 'give another folder, or its rights',
}


class StageError(Exception):
    """Something that the user can mend; the message names the thing and the remedy."""


def command_line(main: Callable[Arguments, int | None]) -> Callable[Arguments, int]:
    """Turn a :class:`StageError` of a command into one line on stderr and exit status 2.

    So it does with a disk that refuses. Ctrl-C ends it without a word, with exit status 130.
    """

    @functools.wraps(main)
    def wrapped(*args: Arguments.args, **kwargs: Arguments.kwargs) -> int:
        try:
            return main(*args, **kwargs) or 0
        except StageError as error:
            print(f'error: {" ".join(str(error).split())}', file=sys.stderr)
            return EXIT_BAD_INPUT
        except OSError as error:
            if error.errno not in DISK_REFUSES:
                raise
            where = error.filename or 'the disk of the results'
            print(
                f'error: {where}: {error.strerror}: {DISK_REFUSES[error.errno]}', file=sys.stderr
            )
            return EXIT_BAD_INPUT
        except KeyboardInterrupt:
            return EXIT_INTERRUPTED

    return wrapped
