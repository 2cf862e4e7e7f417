"""When the log says that something is wrong with the tracker, and when that it is well again."""

from __future__ import annotations

#: A tracker that starts together with the node is no trouble yet [s]. On two busy cores the
#: emulated one answered 8 s after the bridge had begun to ask.
STARTING = 15.0
#: What passes sooner is no trouble [s]; what stays is said again after a while [s].
PASSING, AGAIN = 2.0, 5.0


class Complaints:
    """What the log gets, for a node that starts at `now` [s]; `/diagnostics` does not wait."""

    def __init__(self, now: float) -> None:
        self._silent_until, self._complained = now + STARTING, False

    def due(self, trouble: str, connected: bool, now: float) -> str:
        """Line for the log at `now` [s]; empty where nothing is to be said."""
        if trouble and now >= self._silent_until:
            self._silent_until, self._complained = now + AGAIN, True
            return trouble
        if trouble:
            return ''
        # A tracker that was there has started.
        started = now + PASSING
        self._silent_until = started if connected else max(self._silent_until, started)
        if self._complained and connected:
            self._complained = False
            return 'the tracker is connected now'
        return ''
