"""A session as arrays: what a bag or a simulation hands to the algorithms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stage_core import topics
from stage_core.arrays import Array
from stage_core.clocks import to_seconds
from stage_core.errors import StageError
from stage_core.frames import RigidTransform
from stage_core.quantities import AXES


@dataclass(frozen=True)
class Series:
    """Messages of one topic: stamps (n,) [ns] and columns of shape (n,), SI units.

    Columns are named ``position.x``, ``velocity.y``, ``effort.x`` for a JointState; ``x``,
    ``y``, ``z`` for points and vectors; ``temperature`` for one temperature sensor;
    ``force.x`` … ``torque.z`` for a wrench.
    """

    topic: str
    stamps: NDArray[np.int64]
    values: dict[str, Array]

    @classmethod
    def per_axis(
        cls,
        topic: str,
        stamps: NDArray[np.int64],
        axes: Sequence[str] = ('x', 'y', 'z'),
        /,
        **quantities: Array,
    ) -> Series:
        """A JointState or a wrench: each quantity by its name, (n, axes), the first of `axes`."""
        values = {
            f'{quantity}.{axis}': rows[:, i]
            for quantity, rows in quantities.items()
            for i, axis in enumerate(axes[: rows.shape[1]])
        }
        return cls(topic, stamps, values)

    @classmethod
    def points(cls, topic: str, stamps: NDArray[np.int64], rows: Array) -> Series:
        """Points or vectors, rows (n, 1 to 3); 0 along the axes that they lack."""
        whole = np.zeros((len(rows), 3))
        whole[:, : rows.shape[1]] = rows
        return cls(topic, stamps, dict(zip('xyz', whole.T, strict=True)))

    def __len__(self) -> int:
        return len(self.stamps)

    def columns(self, quantity: str, axes: tuple[str, ...]) -> Array:
        """Columns ``quantity.axis`` side by side, shape (n, axes).

        Raises
        ------
        StageError
            If the messages lack the quantity for one of the axes.
        """
        missing = [axis for axis in axes if f'{quantity}.{axis}' not in self.values]
        if missing:
            raise StageError(
                f'{self.topic} holds no {quantity} of axis {missing[0]}: record the session again '
                'with a driver that publishes it'
            )
        return np.column_stack([self.values[f'{quantity}.{axis}'] for axis in axes])

    def between(self, start: int, stop: int) -> Series:
        """The messages with start <= stamp < stop [ns]."""
        inside = (self.stamps >= start) & (self.stamps < stop)
        return Series(
            self.topic, self.stamps[inside], {k: v[inside] for k, v in self.values.items()}
        )


@dataclass(frozen=True)
class Session:
    """Topics of a session by name; a temperature sensor has a key of its own."""

    path: str
    series: dict[str, Series]
    twin: dict[str, Any] | None = None
    alignment: RigidTransform | None = None
    warnings: tuple[str, ...] = field(default=())
    #: Wall time of the first message [ns]; that of the stamps where the bag holds no other.
    recorded_ns: int = 0

    def has(self, topic: str) -> bool:
        """Whether the topic holds a message; an empty one counts as absent."""
        return topic in self.series and len(self.series[topic]) > 0

    def require(self, topic: str, why: str = '') -> Series:
        """The series of a topic.

        Raises
        ------
        StageError
            If the session has no message of it.
        """
        if not self.has(topic):
            purpose = f', which {why}' if why else ''
            raise StageError(
                f'{self.path} holds no message of {topic}{purpose}: record the session again '
                f'with {topic} among the recorded topics'
            )
        return self.series[topic]

    @property
    def start_ns(self) -> int:
        """Stamp of the first reference [ns]; of the earliest message where there is none."""
        if self.has(topics.REFERENCE):
            return int(self.series[topics.REFERENCE].stamps[0])
        stamps = [int(s.stamps[0]) for s in self.series.values() if len(s)]
        if not stamps:
            raise StageError(f'{self.path} holds no message: record the session again')
        return min(stamps)

    def seconds(self, topic: str) -> Array:
        """Time of each message of a topic since the session's start [s], shape (n,)."""
        return to_seconds(self.require(topic).stamps, self.start_ns)

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes of the session: those with a reference, else with an encoder position."""
        for topic in (topics.REFERENCE, topics.JOINT_STATES):
            if self.has(topic):
                values = self.series[topic].values
                found = tuple(axis for axis in AXES if f'position.{axis}' in values)
                if found:
                    return found
        raise StageError(f'{self.path} names no axis x or y in its stage topics')

    def table_points(self) -> Array:
        """Tracker points in the stage's frame, shape (n, 3) [m]; identity without alignment."""
        series = self.require(topics.TRACKER_POINT, 'measures the table')
        points = np.column_stack([series.values[axis] for axis in ('x', 'y', 'z')])
        return points if self.alignment is None else self.alignment.apply(points)

    def temperatures(self) -> dict[str, Series]:
        """Series of each temperature sensor by its name."""
        prefix = topics.temperature_key('')
        return {k[len(prefix) :]: s for k, s in self.series.items() if k.startswith(prefix)}


def by_topic(*series: Series) -> dict[str, Series]:
    """Series as a session holds them; sensors of temperature have keys of their own."""
    return {one.topic: one for one in series}
