"""The gap of a running session: per channel and window, against the band that it had."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.closed_loop.replay import declared_commands
from gap_diagnosis.input.data import Record, motion_step
from gap_diagnosis.input.ticks import machine_clock, tick_numbers
from stage_core.arrays import Array
from stage_core.frames import RigidTransform
from stage_core.twin_file import TwinFile
from stage_twin.simulate import simulate

BACK = 10**9  # ns by which stamps may run backwards before another session has begun
MOST_WINDOWS = 2  # windows of messages that are kept while a topic is silent: 3 MiB each
SETTLING = 1.0  # s at a window's start in which the replay finds the loop's state


@dataclass
class Band:
    """Where a channel's gap was in the first windows, and whether it has left it."""

    learn: int
    width: float
    floor: float
    values: list[float] = field(default_factory=list)
    latest: float = float('nan')

    def take(self, rms: float) -> None:
        """Add the RMS gap of one window; the first `learn` ones make the band."""
        self.latest = rms
        if len(self.values) < self.learn:
            self.values.append(rms)

    @property
    def ready(self) -> bool:
        """Whether the band is known."""
        return len(self.values) >= self.learn

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper limit: median ± `width` robust deviations, never below the floor."""
        values = np.asarray(self.values)
        middle = float(np.median(values))
        # 1.4826 turns a median deviation into a standard deviation for normal numbers.
        spread = 1.4826 * float(np.median(np.abs(values - middle)))
        reach = self.width * max(spread, 0.05 * middle, 0.2 * self.floor)
        return max(middle - reach, 0.0), middle + reach

    @property
    def left(self) -> bool:
        """Whether the latest window lies outside the band."""
        low, high = self.limits if self.ready else (0.0, np.inf)
        return self.ready and not low <= self.latest <= high


class LiveMonitor:
    """Collects ticks and tracker points; judges each full window by a replay of the twin.

    Parameters
    ----------
    twin : kind servo, nominal or corrected
    window : length of a window [s]
    learn : windows that make the band
    width : of the band, in standard deviations
    """

    def __init__(
        self, twin: TwinFile, window: float = 6.0, learn: int = 5, width: float = 5.0
    ) -> None:
        self.twin = twin
        self.window = window
        self.alignment = RigidTransform.identity()
        self.axes: tuple[str, ...] = ()
        self.bands: dict[str, Band] = {}
        self._learn, self._width = learn, width
        self._topics: dict[str, dict[int, tuple[float, ...]]] = {}
        self._points: list[tuple[int, float, float, float]] = []
        self._latest = 0

    def add(
        self, topic: str, stamp: int, axes: tuple[str, ...], values: tuple[float, ...]
    ) -> None:
        """One message of reference, command or joint states: its columns one after the other."""
        if stamp < self._latest - BACK:
            # Simulated time begins anew with each start of the machine.
            self.clear()
        self._latest = stamp
        if axes != self.axes:
            self.clear()
            self.axes = axes
        self._topics.setdefault(topic, {})[stamp] = values

    def add_point(self, stamp: int, x: float, y: float, z: float) -> None:
        """One point of the tracker [m]."""
        self._points.append((stamp, x, y, z))

    def clear(self) -> None:
        """Forget what is collected; the bands stay."""
        self._topics.clear()
        self._points.clear()

    def judge(self) -> bool:
        """Judge the collected window if it is full; whether one was judged."""
        period = self.twin.control_period
        stamps = self._common()
        if len(stamps) < 2 or (len(stamps) - 1) * period < self.window:
            kept = max(map(len, (self._points, *self._topics.values())))
            if kept > MOST_WINDOWS * self.window / period:
                self.clear()
            return False
        record = self._record(stamps)
        seconds = (stamps - stamps[0]) * 1e-9
        resolution = np.array([motion_step(self.twin, axis) for axis in self.axes])
        numbers = tick_numbers(seconds, period, record.encoder, resolution)
        if len(stamps) < 0.99 * (int(numbers[-1]) + 1):
            # Lost ticks: a replay of what is left would show a gap that the machine has not.
            self.clear()
            return False
        _, clock = machine_clock(seconds, numbers, period)
        start = int(stamps[0])
        points = np.array([p[1:] for p in self._points]).reshape(-1, 3)
        times = np.array([1e-9 * (p[0] - start) for p in self._points], dtype=np.float64)
        # Points from before the window have no place on its clock.
        points, times = points[times > 0.0], times[times > 0.0]
        times = times if clock is None else clock.to_machine(times)
        self.clear()
        self._compare(record, times, self.alignment.apply(points))
        return True

    def _common(self) -> NDArray[np.int64]:
        """Stamps [ns] that all topics have, where they speak of axes of the twin."""
        unknown = set(self.axes) - set(self.twin.axes)
        if len(self._topics) < 3 or unknown or len(set(self.axes)) < len(self.axes):
            return np.empty(0, dtype=np.int64)
        common = set.intersection(*(set(t) for t in self._topics.values()))
        return np.array(sorted(common), dtype=np.int64)

    def _record(self, stamps: NDArray[np.int64]) -> Record:
        count = len(self.axes)
        topics = list(self._topics)
        rows = {
            topic: np.array([self._topics[topic][s] for s in stamps.tolist()]) for topic in topics
        }
        reference, command, states = (
            next(rows[t] for t in topics if t.endswith(end))
            for end in ('reference', 'command', 'joint_states')
        )
        return Record(
            name='live',
            axes=self.axes,
            period=self.twin.control_period,
            time=np.linspace(0.0, (len(stamps) - 1) * self.twin.control_period, len(stamps)),
            reference=reference[:, :count],
            reference_velocity=reference[:, count : 2 * count],
            velocity_command=command[:, :count],
            force=command[:, count : 2 * count],
            encoder=states[:, :count],
            temperature=None,
            tracker_time=None,
            tracker=None,
            # The watch is for the plant: what the controller commanded is its input.
            setpoint_velocity=np.ones(len(stamps), dtype=bool),
        )

    def _compare(self, record: Record, times: Array, points: Array) -> None:
        # The replay starts at rest on the reference: it must start where the axis stood.
        machine = replace(self.twin, axes={a: self.twin.axes[a] for a in self.axes})
        inside = (times > SETTLING) & (times < record.time[-1])
        result = simulate(
            machine,
            record.reference,
            record.reference_velocity,
            compensation=declared_commands(record, self.twin),
            tracker_times=times[inside],
            noise=False,
        )
        settled = record.time > SETTLING
        for i, axis in enumerate(self.axes):
            gap = (record.encoder - result.encoder)[settled, i]
            step = self.twin.servo(axis).encoder_resolution
            self._take(f'encoder.{axis}', gap, step / np.sqrt(12.0))
            if np.count_nonzero(inside) > 20:
                column = ('x', 'y').index(axis)
                noise = self.twin.tracker.noise if self.twin.tracker is not None else 1e-6
                gap = (points[inside] - result.tracker_points)[:, column]
                self._take(f'tracker.{axis}', gap, noise)

    def _take(self, channel: str, gap: Array, floor: float) -> None:
        band = self.bands.setdefault(channel, Band(self._learn, self._width, floor))
        band.take(float(np.sqrt(np.mean(gap**2))))
