"""Ctrl-C, SIGTERM and the end of the terminal: heard once, and then remembered."""

from __future__ import annotations

import signal

from stage_core.signals import ending


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, SIGTERM or SIGHUP.

    `python -m` ends by SIGINT, whatever the exit status, if a plain KeyboardInterrupt once came up
    inside an `exec`, as that of each dataclass is while modules are imported.
    """


class Interrupts:
    """Takes what ends a process: the graph is ended before this process is.

    What a signal raises can get lost: a finalizer drops it, and so does compiled code that clears
    or replaces an error, as Cython's modules do while they are imported. So it is remembered too.
    """

    def __init__(self) -> None:
        self.came = False
        #: From now on signals are only remembered: nothing may stop the end of the nodes.
        self.ending = False
        for number in ending():
            signal.signal(number, self._take)

    def _take(self, *_: object) -> None:
        self.came = True
        if not self.ending:
            raise Interrupted

    def check(self) -> None:
        """Raise again what may have been lost."""
        if self.came:
            raise Interrupted
