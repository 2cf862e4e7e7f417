"""Tracker points of a recorded session, at the pace of their stamps."""

from __future__ import annotations

import time
from pathlib import Path

from session_bags.reader import read_session
from stage_core import topics
from stage_core.clocks import NANOSECONDS
from stage_core.errors import StageError
from tracker_bridge.samples import Sample
from tracker_bridge.sources.base import Deliver, Source


class ReplaySource(Source):
    """Deliver the tracker points of a session bag once, with the stamps that they have.

    Parameters
    ----------
    bag
        Session folder.
    rate
        Factor on the pace; 0: as fast as possible.

    Raises
    ------
    StageError
        When the bag cannot be read or holds no tracker points.
    """

    def __init__(self, deliver: Deliver, bag: str | Path, rate: float = 1.0) -> None:
        super().__init__(deliver)
        if not str(bag):
            raise StageError('source replay needs a session: set the parameter bag')
        session = read_session(Path(bag), topics=[topics.TRACKER_POINT])
        if not session.has(topics.TRACKER_POINT):
            raise StageError(f'{bag} holds no {topics.TRACKER_POINT}: choose another session')
        series = session.series[topics.TRACKER_POINT]
        self._stamps = series.stamps.tolist()
        self._points = list(zip(*(series.values[axis].tolist() for axis in 'xyz'), strict=True))
        self._rate = rate

    def run(self) -> None:
        """Deliver every point, then end."""
        self.connected = True
        begin = time.monotonic()
        for stamp, (x, y, z) in zip(self._stamps, self._points, strict=True):
            if self._rate > 0.0:
                due = begin + (stamp - self._stamps[0]) / NANOSECONDS / self._rate
                if self.ended.wait(max(0.0, due - time.monotonic())):
                    return
            elif self.ended.is_set():
                return
            self.deliver(Sample((x, y, z), time.time_ns(), stamp))
        self.connected = False
        self.trouble = 'the replayed session has ended: start tracker_bridge again to repeat it'
