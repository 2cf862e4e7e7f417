"""Pairs of stage position and tracker point, collected while the stage is at rest.

Everything is decided from stamps: the same two streams give the same pairs, however they were
interleaved on arrival.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from stage_core.arrays import Array
from stage_core.clocks import NANOSECONDS
from stage_core.quantities import AXES
from stage_core.rests import Standstill
from tracker_bridge.samples import Point

MAXIMUM_POINTS = 20_000
#: Stamps of the stage that go back by this much [ns] begin anew.
RESTARTED = 1_000_000_000
FEWEST_POINTS = 3


@dataclass(frozen=True)
class RestRules:
    """What counts as a rest, and which part of it is used.

    Attributes
    ----------
    tolerance
        Largest distance of the encoder from where the rest began, per axis [m].
    shortest
        Least length of a rest [s].
    settle, guard
        Parts at its beginning and end that are not used [s]: the stage still settles, and the
        tracker's clock is not known to better than some milliseconds.
    longest
        A longer rest is used up to this length [s].
    """

    tolerance: float = 3e-6
    shortest: float = 0.15
    settle: float = 0.05
    guard: float = 0.02
    longest: float = 2.0


@dataclass
class _Rest:
    """A rest in progress; positions younger than the guard wait in `recent`."""

    begin: int
    end: int
    total: Array
    count: int
    recent: deque[tuple[int, tuple[float, ...]]]


@dataclass(frozen=True)
class RestPair:
    """Mean stage position and mean tracker point of one rest [m], with the number of points."""

    begin: int
    end: int
    stage: Array
    tracker: Array
    count: int


class RestPairs:
    """Collect pairs from the streams of stage positions and tracker points.

    Parameters
    ----------
    rules
        What counts as a rest.
    capacity
        Most pairs kept; the oldest go first.
    """

    def __init__(self, rules: RestRules | None = None, capacity: int = 1000) -> None:
        self.rules = rules or RestRules()
        self._pairs: deque[RestPair] = deque(maxlen=capacity)
        self._waiting: deque[tuple[int, int, Array]] = deque(maxlen=capacity)
        self._points: deque[tuple[int, Point]] = deque(maxlen=MAXIMUM_POINTS)
        self._standstill = Standstill(self.rules.tolerance)
        self._rest: _Rest | None = None
        self.last_stage: int | None = None
        self.without_points = 0

    def clear(self) -> None:
        """Forget every pair; a rest in progress begins anew."""
        self._pairs.clear()
        self._begin_anew()
        self.without_points = 0

    def _begin_anew(self) -> None:
        self._waiting.clear()
        self._points.clear()
        self._rest = None
        self._standstill = Standstill(self.rules.tolerance)

    def __len__(self) -> int:
        """Return the number of complete pairs."""
        return len(self._pairs)

    def add_stage(self, stamp: int, position: tuple[float, ...]) -> None:
        """Take an encoder reading [m] of a stamp [ns]; stamps that do not increase are ignored.

        One of more axes than a stage has is another machine's, and ignored too.
        A stamp that is much older than the last one is that of a stage that was started again.
        """
        if len(position) > len(AXES):
            return
        if self.last_stage is not None and stamp <= self.last_stage:
            if self.last_stage - stamp < RESTARTED:
                return
            self._begin_anew()
        self.last_stage = stamp
        rest = self._rest
        if self._standstill.moved(position) or rest is None:
            self._waiting += self._so_far()
            self._rest = _Rest(stamp, stamp, np.zeros(len(position)), 0, deque())
            return
        if stamp - rest.begin > round(self.rules.longest * NANOSECONDS):
            return
        rest.end = stamp
        rest.recent.append((stamp, position))
        self._use(rest)

    def _window(self, rest: _Rest) -> tuple[int, int]:
        settle, guard = self.rules.settle, self.rules.guard
        return rest.begin + round(settle * NANOSECONDS), rest.end - round(guard * NANOSECONDS)

    def _use(self, rest: _Rest) -> None:
        begin, end = self._window(rest)
        while rest.recent and rest.recent[0][0] <= end:
            stamp, position = rest.recent.popleft()
            if stamp >= begin:
                rest.total += position
                rest.count += 1

    def _so_far(self) -> list[tuple[int, int, Array]]:
        """Window and mean position of the rest in progress, where it is long enough by now."""
        rest = self._rest
        shortest = round(self.rules.shortest * NANOSECONDS)
        if rest is None or not rest.count or rest.end - rest.begin < shortest:
            return []
        return [(*self._window(rest), rest.total / rest.count)]

    def add_point(self, stamp: int, point: Point) -> None:
        """Take a tracker point [m] of a stamp [ns]; completes the rests that end before it."""
        self._points.append((stamp, point))
        while self._waiting and stamp >= self._waiting[0][1]:
            interval = self._waiting.popleft()
            pair = self._pair(*interval)
            if pair is None:
                self.without_points += 1
            else:
                self._pairs.append(pair)
            while self._points and self._points[0][0] < interval[1]:
                self._points.popleft()

    def _pair(self, begin: int, end: int, stage: Array) -> RestPair | None:
        inside = [point for stamp, point in self._points if begin <= stamp <= end]
        if len(inside) < FEWEST_POINTS:
            return None
        place = np.zeros(3)
        place[: len(stage)] = stage
        return RestPair(begin, end, place, np.mean(inside, axis=0), len(inside))

    def pairs(self) -> list[RestPair]:
        """Return all pairs, with those of rests that still last or whose points still come."""
        intervals = [*self._waiting, *self._so_far()]
        found = [*self._pairs, *(self._pair(*interval) for interval in intervals)]
        return [pair for pair in found if pair is not None]
