"""Whose time a Zaber line keeps: the machine's, or virtual time that the line itself drives."""

from __future__ import annotations

import threading
import time

from stage_core.clocks import LOCKSTEP_EXCHANGE, NANOSECONDS


class WallClock:
    """Real time."""

    def now(self) -> int:
        """Time [ns]."""
        return time.time_ns()

    def elapsed(self) -> float:
        """Time that never jumps, from an arbitrary origin [s]."""
        return time.monotonic()

    def line_sent(self) -> None:
        """Take note of a command line that has left."""


class LineClock(WallClock):
    """Virtual time of an emulated chain in lockstep: each command line lets some of it pass.

    The emulator counts the same lines, so both ends know the time without asking.

    Parameters
    ----------
    origin
        Time before the first line [ns].
    """

    def __init__(self, origin: int) -> None:
        self._now = origin
        self._lock = threading.Lock()

    def now(self) -> int:
        """Time [ns]."""
        return self._now

    def elapsed(self) -> float:
        """See `WallClock.elapsed`."""
        return self._now / NANOSECONDS

    def line_sent(self) -> None:
        """Let the time of one exchange pass."""
        with self._lock:
            self._now += LOCKSTEP_EXCHANGE
