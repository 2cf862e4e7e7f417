"""What every source has: a thread that delivers samples, and a status in plain words."""

from __future__ import annotations

import threading
from collections.abc import Callable

from tracker_bridge.samples import Sample

Deliver = Callable[[Sample], None]
#: A source looks this often whether it shall end [s].
POLL = 0.2


class Source(threading.Thread):
    """A thread that delivers samples until it is stopped.

    Parameters
    ----------
    deliver
        Called in this thread with every sample.

    Attributes
    ----------
    connected
        Whether points can come.
    trouble
        What is wrong and the remedy; empty when nothing is.
    counters
        What the source has counted, for /diagnostics.
    """

    def __init__(self, deliver: Deliver) -> None:
        super().__init__(name='tracker_source', daemon=True)
        self.deliver = deliver
        self.connected = False
        self.trouble = ''
        self.counters: dict[str, int] = {}
        self.ended = threading.Event()

    def count(self, name: str) -> None:
        """Add one to a counter."""
        self.counters[name] = self.counters.get(name, 0) + 1

    def new_session(self) -> None:
        """Forget what was locked on the first datagrams, as the unit."""

    def stop(self) -> None:
        """End the thread; returns when it has ended."""
        self.ended.set()
        if self.is_alive():
            self.join(timeout=5.0)
