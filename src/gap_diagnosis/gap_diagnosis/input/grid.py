"""The control ticks that reference, command and joint states have in common."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from gap_diagnosis.input.ticks import Clock, machine_clock, tick_numbers
from stage_core.arrays import Array
from stage_core.clocks import to_seconds
from stage_core.errors import StageError
from stage_core.session import Series

Ints = NDArray[np.int64]

LONG = 5  # ticks lost in a row, from which on nothing is interpolated for a judgement
SAME = 0.9  # share of stamps that two topics have in common, from which on they name ticks


def control_period(reference: Series, expected: float, path: str) -> float:
    """The twin's control period [s], refused where the reference has another one.

    Raises
    ------
    StageError
        If the stamps belong to another period, or are too few.
    """
    if len(reference) < 3:
        raise StageError(f'{path} is too short: it holds {len(reference)} messages of reference')
    if reference.stamps[0] == reference.stamps[-1]:
        raise StageError(
            f'{path}: every message of {reference.topic} has the same stamp in its header '
            f'({int(reference.stamps[0])} ns): the driver has to stamp each tick (times of '
            'arrival are not used)'
        )
    gaps = np.diff(reference.stamps) * 1e-9 / expected
    period, mean = float(np.median(gaps)), float(gaps.mean())
    # On a busy machine most ticks may be late: some are in time.
    in_time = float(np.mean(np.abs(gaps - 1.0) < 0.02))
    if abs(period - 1.0) > 0.2 and abs(mean - 1.0) > 0.2 and in_time < 0.05:
        raise StageError(
            f'{path} has a control period of {1e3 * expected * period:.3g} ms but the twin one of '
            f'{1e3 * expected:.3g} ms: give the twin file of this machine'
        )
    return expected


class Grid:
    """Columns of several topics on common ticks.

    Attributes
    ----------
    numbers : of the ticks (n,)
    time : machine's time of the ticks (n,) [s]
    clock : map from stamps to that time; None where they are the same
    offset : stamps of the states from their ticks (n,) [s]; 0 where ticks were lost
    gaps : stretches [s] in which a topic lost more than `LONG` ticks in a row

    Raises
    ------
    StageError
        If the topics do not overlap in time or lack too many ticks.
    """

    def __init__(
        self,
        start: int,
        period: float,
        series: tuple[Series, ...],
        axes: tuple[str, ...],
        resolution: Array,
        path: str,
    ) -> None:
        self.period, self.path = period, path
        states = series[-1]
        self._overlap(series)
        stamps = np.unique(np.concatenate([s.stamps for s in series]))
        self.clock: Clock | None = None
        if all(len(s) > SAME * len(stamps) for s in series):
            seconds = to_seconds(stamps, start)
            numbers = tick_numbers(seconds, period, _at(states, stamps, axes), resolution)
            line, self.clock = machine_clock(seconds, numbers, period)
            self.ticks = {s.topic: numbers[np.searchsorted(stamps, s.stamps)] for s in series}
        else:
            # Each topic has stamps of its own: they are counted one by one.
            self.ticks = {s.topic: self._counted(s, start) for s in series}
            numbers = self.ticks[states.topic]
            fitted = np.polyfit(numbers, to_seconds(states.stamps, start), 1)
            line = np.asarray(np.polyval(fitted, numbers), dtype=np.float64)
        missing = self._missing()
        first = max(int(t[0]) for t in self.ticks.values())
        last = min(int(t[-1]) for t in self.ticks.values())
        if last <= first:
            self._no_overlap(series)
        self.numbers = np.arange(first, last + 1)
        slope = float(line[-1] - line[0]) / max(int(numbers[-1] - numbers[0]), 1)
        self.time = np.asarray(line[0] + slope * (self.numbers - numbers[0]), dtype=np.float64)
        self.offset = self._offset(to_seconds(states.stamps, start), self.ticks[states.topic])
        self.gaps = self._gaps()
        self.warnings = self._warnings(missing)

    def _overlap(self, series: tuple[Series, ...]) -> None:
        if max(int(s.stamps[0]) for s in series) >= min(int(s.stamps[-1]) for s in series):
            self._no_overlap(series)

    def _no_overlap(self, series: tuple[Series, ...]) -> None:
        raise StageError(
            f'{self.path}: the stamps of {", ".join(s.topic for s in series)} do not overlap in '
            'time: all of them must be stamped by the same clock'
        )

    def _offset(self, seconds: Array, ticks: Ints) -> Array:
        offset = np.zeros(len(self.numbers))
        if self.clock is None:
            at = ticks - self.numbers[0]
            own = (at >= 0) & (at < len(offset))
            offset[at[own]] = seconds[own] - self.time[at[own]]
        return offset

    def _gaps(self) -> tuple[tuple[float, float], ...]:
        found = set()
        for ticks in self.ticks.values():
            own = ticks[(ticks >= self.numbers[0]) & (ticks <= self.numbers[-1])]
            for k in np.flatnonzero(np.diff(own) > LONG).tolist():
                ends = own[k : k + 2] - self.numbers[0]
                found.add((float(self.time[ends[0]]), float(self.time[ends[1]])))
        return tuple(sorted(found))

    def _missing(self) -> float:
        """Share of its ticks that a topic lacks; refused before so many are laid out."""
        lacks = {n: 1.0 - len(np.unique(t)) / (t[-1] - t[0] + 1) for n, t in self.ticks.items()}
        topic = max(lacks, key=lambda name: lacks[name])
        if lacks[topic] > 0.2:
            steps = np.diff(self.ticks[topic])
            at = int(np.argmax(steps))
            raise StageError(
                f'{self.path} lacks {100 * lacks[topic]:.0f} % of its control ticks (the longest '
                f'gap of {topic} is {steps[at] * self.period:.3g} s, after its message number '
                f'{at + 1}): record it again, or cut that part out'
            )
        return float(lacks[topic])

    def _warnings(self, missing: float) -> tuple[str, ...]:
        warnings = []
        if missing > 1e-3:
            warnings.append(
                f'{100 * missing:.1f} % of the ticks are missing and were interpolated'
                + (f'; around {len(self.gaps)} long gaps nothing is judged' if self.gaps else '')
            )
        if self.clock is not None:
            ran, passed = np.ptp(self.clock.machine), np.ptp(self.clock.stamps)
            warnings.append(
                f'the machine ran {ran:.1f} s of the {passed:.1f} s between the stamps (it waited '
                'for late forces): times are those of the machine'
            )
        return tuple(warnings)

    def _counted(self, series: Series, start: int) -> Ints:
        seconds = to_seconds(series.stamps, start)
        span = len(series) - 1
        # Jittered stamps of a complete series are counted; with gaps they are rounded.
        if span > 0 and abs((seconds[-1] - seconds[0]) / self.period - span) < 2.0:
            return np.arange(span + 1) + int(
                np.rint(np.median(seconds / self.period - np.arange(span + 1)))
            )
        return np.asarray(np.rint(seconds / self.period), dtype=np.int64)

    @property
    def stamp_time(self) -> Array:
        """Stamps of the ticks (n,) [s]."""
        return self.time if self.clock is None else self.clock.to_stamps(self.time)

    def columns(self, series: Series, quantity: str, axes: tuple[str, ...]) -> Array:
        """Quantity of each axis on the common ticks, shape (n, a)."""
        values = series.columns(quantity, axes)
        ticks = self.ticks[series.topic]
        return np.column_stack(
            [np.interp(self.numbers, ticks, values[:, i]) for i in range(len(axes))]
        )

    def positions(self, series: Series, axes: tuple[str, ...]) -> Array:
        """Position of each axis on the common ticks, shape (n, a) [m].

        A few lost ticks are filled by a cubic spline through the others, long gaps by a line.
        """
        line = self.columns(series, 'position', axes)
        ticks, first = np.unique(self.ticks[series.topic], return_index=True)
        if len(ticks) < 4 or ticks[-1] - ticks[0] + 1 == len(ticks):
            return line
        after = np.clip(np.searchsorted(ticks, self.numbers), 1, len(ticks) - 1)
        short = ticks[after] - ticks[after - 1] <= LONG
        curve = CubicSpline(ticks, series.columns('position', axes)[first])
        return np.where(short[:, None], curve(self.numbers), line)

    def optional(self, series: Series, quantity: str, axes: tuple[str, ...]) -> Array:
        """As `columns`; NaN where the topic does not carry the quantity."""
        if any(f'{quantity}.{axis}' not in series.values for axis in axes):
            return np.full((len(self.numbers), len(axes)), np.nan)
        return self.columns(series, quantity, axes)


def _at(states: Series, stamps: Ints, axes: tuple[str, ...]) -> Array:
    """Encoder (n, a) at the stamps of all topics."""
    values = states.columns('position', axes)
    own = (states.stamps - stamps[0]).astype(np.float64)
    at = (stamps - stamps[0]).astype(np.float64)
    return np.column_stack([np.interp(at, own, values[:, i]) for i in range(len(axes))])
