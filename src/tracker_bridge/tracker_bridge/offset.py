"""The constant offset between the source's clock and ROS time (docs/reference/interfaces.md)."""

from __future__ import annotations

from collections.abc import Sequence

from stage_core.clocks import NANOSECONDS
from tracker_bridge.samples import Sample

WINDOW_NS = 2 * NANOSECONDS
# Longer than any network delay, shorter than a change of the source's clock.
TIME_JUMP_NS = NANOSECONDS
# Points that wait while the window lasts: two seconds of a flood, then the window closes.
MAXIMUM_WAITING = 20_000


class ClockOffset:
    """Estimate the offset once: min(receive - source) over the first two seconds.

    The minimum is the least delayed point; a mean would take over the network's delay. Points of
    the window wait until it is known, so that every stamp of a session has the same offset. A
    clock that jumps meanwhile gives up what waits, and the window begins anew.

    Parameters
    ----------
    fixed_ns
        A known offset [ns] (0: the source's clock is ROS time); None to estimate it.

    Attributes
    ----------
    given_up
        Samples that the last `feed` gave up.
    """

    def __init__(self, fixed_ns: int | None = None) -> None:
        self.offset_ns = fixed_ns
        self.given_up = 0
        self._first_ns = 0
        self._smallest: int | None = None
        self._waiting: list[Sample] = []

    def feed(self, sample: Sample) -> Sequence[tuple[int, Sample]]:
        """Return the samples whose stamp [ns] in ROS time is now known, with it."""
        self.given_up = 0
        if sample.source_ns is None:
            return [(sample.receive_ns, sample)]
        if self.offset_ns is not None:
            return [(sample.source_ns + self.offset_ns, sample)]
        difference = sample.receive_ns - sample.source_ns
        if self._smallest is None or abs(difference - self._smallest) > TIME_JUMP_NS:
            self.given_up, self._waiting = len(self._waiting), []
            self._first_ns, self._smallest = sample.receive_ns, difference
        over = sample.receive_ns - self._first_ns >= WINDOW_NS
        if not over:
            self._smallest = min(self._smallest, difference)
        self._waiting.append(sample)
        if not over and len(self._waiting) < MAXIMUM_WAITING:
            return []
        self.offset_ns = self._smallest
        waiting, self._waiting = self._waiting, []
        return [(s.source_ns + self.offset_ns, s) for s in waiting if s.source_ns is not None]
