"""From samples of a source to stamped points: checks, counters, and what to say about them."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from stage_core.clocks import NANOSECONDS
from tracker_bridge.offset import TIME_JUMP_NS, ClockOffset
from tracker_bridge.samples import Point, Sample

CLOCK_LOST = "the source's clock has jumped, its points are dropped: call ~/reset"


@dataclass(frozen=True)
class Limits:
    """When the stream is worth a warning.

    Attributes
    ----------
    rate
        Expected points per second [Hz]; 0: not known.
    gap
        Longest time between two points [s].
    age
        Oldest point on arrival [s], which tells nothing in lockstep and is not watched there;
        longest silence [s].
    jump
        Largest distance between two consecutive points [m].
    identical
        Longest run of identical points: "not proven fresh".
    quantum
        Coarsest resolution of displayed numbers [m].
    """

    rate: float = 100.0
    gap: float = 0.1
    age: float = 0.5
    jump: float = 0.02
    identical: int = 20
    quantum: float = 1e-6


@dataclass
class Counters:
    """What happened to the samples since the last reset."""

    received: int = 0
    published: int = 0
    bad_status: int = 0
    not_finite: int = 0
    duplicates: int = 0
    out_of_order: int = 0
    time_jumps: int = 0
    gaps: int = 0
    jumps: int = 0

    @property
    def refused(self) -> int:
        """Samples that say nothing new, or say that they are bad."""
        return self.bad_status + self.not_finite + self.duplicates + self.out_of_order


class Bridge:
    """Check samples of a source and stamp those that are fit to be published.

    The stamps of what it returns increase strictly: a duplicate, a point that comes late, one
    with a bad status or a number that is none, and one whose clock has jumped are counted and
    dropped. A gap or a leap in space is counted and published: it may be true.

    Parameters
    ----------
    limits
        What is watched.
    source_clock
        ``own``: the source's clock has an unknown constant offset; ``ros``: it is ROS time.
    """

    def __init__(self, limits: Limits | None = None, source_clock: str = 'own') -> None:
        self.limits = limits or Limits()
        self.counters = Counters()
        self.source_clock = source_clock
        self.clock_lost = False
        self.identical = 0
        self.longest_gap = 0.0
        self.rate = 0.0
        self.age = 0.0
        self.silence = 0.0
        self._heard = (-1, 0)
        self._offset = ClockOffset(0 if source_clock == 'ros' else None)
        self._last: tuple[int, Point] | None = None

    @property
    def offset_ns(self) -> int | None:
        """Return the offset from the source's clock to ROS time [ns], None while unknown."""
        return self._offset.offset_ns

    @property
    def last_stamp(self) -> int | None:
        """Return the stamp of the newest point published [ns]."""
        return None if self._last is None else self._last[0]

    def reset(self) -> None:
        """Set the counters to zero; after a jump of the clock, also take a new offset."""
        self.counters = Counters()
        self.identical = 0
        self.longest_gap = self.age = self.rate = 0.0
        if self.clock_lost:
            self._offset = ClockOffset(0 if self.source_clock == 'ros' else None)
            self._last = None
            self.clock_lost = False

    def look(self, now: int, connected: bool) -> None:
        """Note for how long a connected source has sent no good point; `now` [ns] is ROS time.

        Called about once a second: a world that waits in lockstep has no silence, and what came
        between two calls ends it.
        """
        good = self.counters.received - self.counters.refused
        if good != self._heard[0] or not connected:
            self._heard = (good, now)
        self.silence = (now - self._heard[1]) / NANOSECONDS

    def process(self, sample: Sample) -> list[tuple[int, Point]]:
        """Take a sample; return what is now to be published: stamps [ns] and points [m]."""
        self.counters.received += 1
        if sample.status != 0:
            self.counters.bad_status += 1
            return []
        if not all(map(math.isfinite, sample.point)):
            self.counters.not_finite += 1
            return []
        stamped = self._offset.feed(sample)
        self.counters.time_jumps += self._offset.given_up
        accepted = [(stamp, known.point) for stamp, known in stamped if self._accept(stamp, known)]
        self.counters.published += len(accepted)
        return accepted

    def _accept(self, stamp: int, sample: Sample) -> bool:
        last = self._last
        if self.source_clock == 'own' and sample.source_ns is not None:
            late = sample.receive_ns - stamp
            self.age = late / NANOSECONDS
            # Ahead of its own arrival: the source's clock was set forward. Older than its
            # connection: the source was started again, and its clock with it.
            before = sample.opened_ns - stamp
            self.clock_lost = self.clock_lost or late < -TIME_JUMP_NS or before > TIME_JUMP_NS
        if last is not None and stamp - last[0] < -TIME_JUMP_NS:
            self.clock_lost = True
        if self.clock_lost:
            self.counters.time_jumps += 1
            return False
        if last is not None:
            if stamp == last[0]:
                self.counters.duplicates += 1
                return False
            if stamp < last[0]:
                self.counters.out_of_order += 1
                return False
            self._watch(stamp - last[0], sample.point, last[1])
        self._last = (stamp, sample.point)
        return True

    def _watch(self, interval_ns: int, point: Point, before: Point) -> None:
        interval = interval_ns / NANOSECONDS
        self.longest_gap = max(self.longest_gap, interval)
        if interval > self.limits.gap:
            self.counters.gaps += 1
        # A mean over some 50 points, by stamps: it does not depend on when they arrive.
        self.rate = (
            1.0 / interval if self.rate == 0.0 else 1.0 / (0.98 / self.rate + 0.02 * interval)
        )
        self.identical = self.identical + 1 if point == before else 0
        if math.dist(point, before) > self.limits.jump:
            self.counters.jumps += 1

    def complaints(self) -> list[str]:
        """Return what is wrong with the stream, each with the remedy; empty when all is well."""
        limits, counters = self.limits, self.counters
        found = []
        if self.clock_lost:
            found.append(CLOCK_LOST)
        if self.identical > limits.identical:
            found.append(f'{self.identical} identical points, not proven fresh: check the beam')
        if limits.rate and self.silence > limits.age:
            refused = f' ({counters.refused} were refused)' if counters.refused else ''
            found.append(
                f'no point for {self.silence:.1f} s{refused}: check the tracker and its beam'
            )
        if limits.rate and self.rate and not 0.5 < self.rate / limits.rate < 2.0:
            found.append(f'{self.rate:.0f} points per second, expected {limits.rate:.0f}')
        if self.source_clock == 'own' and self.age > limits.age:
            found.append(f'points are {self.age:.2f} s old on arrival: check network and load')
        if counters.jumps:
            found.append(f'{counters.jumps} leaps of more than {limits.jump:g} m')
        if counters.not_finite:
            found.append(f'{counters.not_finite} points were not finite numbers')
        return found

    def values(self) -> dict[str, object]:
        """Return counters and measures for /diagnostics."""
        offset = self.offset_ns
        return {
            **asdict(self.counters),
            'rate': f'{self.rate:.1f}',
            'age': f'{self.age:.4f}',
            'longest_gap': f'{self.longest_gap:.3f}',
            'identical_run': self.identical,
            'clock_offset': 'not known yet' if offset is None else f'{offset / NANOSECONDS:.6f}',
        }
