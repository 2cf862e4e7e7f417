"""How long a wait may take: wall time without progress."""

from __future__ import annotations

import time
from collections.abc import Callable


class Patience:
    """A wait of `length` [s] of wall time.

    It begins anew whenever `progress()` gives another answer: what is slow is not stuck.
    """

    def __init__(self, length: float, progress: Callable[[], object] = lambda: None) -> None:
        self._length, self._progress = length, progress
        self._seen, self._end = progress(), time.monotonic() + length

    def left(self) -> float:
        """What is left of the wait [s]; negative once it is over."""
        seen = self._progress()
        if seen != self._seen:
            self._seen, self._end = seen, time.monotonic() + self._length
        return self._end - time.monotonic()
