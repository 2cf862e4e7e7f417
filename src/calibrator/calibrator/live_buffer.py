"""What the calibrator hears while it runs, in rings of fixed size."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrator.ring import Ring
from calibrator.temperatures import LiveTemperatures
from stage_core import topics
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.frames import RigidTransform
from stage_core.rests import REFERENCE_BAND
from stage_core.session import Series, Session, by_topic
from stage_core.whole_file import replacing

BACK = 1_000_000_000
"""A reference that is earlier than the one before it by this [ns] begins another session."""


class LiveBuffer:
    """Reference, table points, alignment and temperatures of the recent past."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._reference: Ring | None = None
        self._axes: tuple[str, ...] = ()
        self._newest = 0
        self._standing: tuple[Sequence[float], Sequence[float]] | None = None
        self._points = Ring(capacity, 3)
        self.temperatures = LiveTemperatures(capacity)
        self.alignment: RigidTransform | None = None

    def add_reference(self, stamp: int, axes: tuple[str, ...], position: Sequence[float]) -> None:
        """Take a reference; other axes, or a clock that was set back, start the buffer anew."""
        if stamp < self._newest - BACK:
            self._reference, self._points = None, Ring(self._capacity, 3)
            self.temperatures = LiveTemperatures(self._capacity)
        self._newest = stamp
        if self._reference is None or axes != self._axes:
            self._axes, self._reference = axes, Ring(self._capacity, 2 * len(axes))
            self._standing = None
        before, held = self._standing or (position, (0.0,) * len(axes))
        # As `prepare.last_moves`, without arrays: this is done at each tick.
        direction = [
            math.copysign(1.0, new - old) if abs(new - old) >= REFERENCE_BAND else sign
            for new, old, sign in zip(position, before, held, strict=True)
        ]
        self._standing = position, direction
        self._reference.add(stamp, (*position, *direction))

    def standing(self, axes: tuple[str, ...]) -> tuple[Array, Array] | None:
        """Newest reference [m] of these axes and signs of their last moves; None if unheard."""
        if self._standing is None or not set(axes) <= set(self._axes):
            return None
        position, direction = np.array(self._standing)
        chosen = [self._axes.index(axis) for axis in axes]
        return position[chosen], direction[chosen]

    def add_point(self, stamp: int, point: Sequence[float]) -> None:
        """Take a raw tracker point (x, y, z) [m]."""
        self._points.add(stamp, point)

    @property
    def empty(self) -> bool:
        """Whether a reference or a tracker point is still missing."""
        return self._reference is None or not len(self._points)

    def counts(self) -> dict[str, int]:
        """Number of references and points held."""
        held = 0 if self._reference is None else len(self._reference)
        return {'references': held, 'points': len(self._points)}

    def session(self, newest: int | None = None, sensors: Sequence[str] | None = None) -> Session:
        """The buffer as a session: the `newest` messages per topic, these temperature sensors.

        None stands for all of them.

        Raises
        ------
        StageError
            If nothing was heard of the stage or the tracker yet.
        """
        if self._reference is None or not len(self._points):
            raise StageError(
                'the live buffer holds no pair of reference and tracker point: move the stage '
                'with the tracker connected, or set the parameter bag'
            )
        reference, rows = self._reference.content(newest)
        points, places = self._points.content(newest)
        q = len(self._axes)
        series = by_topic(
            Series.per_axis(
                topics.REFERENCE,
                reference,
                self._axes,
                position=rows[:, :q],
                direction=rows[:, q:],
            ),
            Series.points(topics.TRACKER_POINT, points, places),
        )
        series.update(self.temperatures.series(newest, sensors))
        return Session('the live buffer', series, None, self.alignment)


def heard(session: Session) -> str:
    """What a session of a live buffer holds, for a person."""
    references, points = (len(session.series[t]) for t in (topics.REFERENCE, topics.TRACKER_POINT))
    seconds = float(np.ptp(session.series[topics.REFERENCE].stamps)) / 1e9
    return f'{references} references in {seconds:.0f} s and {points} tracker points'


def save_session(session: Session, path: Path) -> None:
    """Write the numbers of a session for another process (.npz)."""
    arrays: dict[str, Array | NDArray[np.int64]] = {}
    for topic, series in session.series.items():
        arrays[f'{topic}|stamps'] = series.stamps
        for name, values in series.values.items():
            arrays[f'{topic}|values|{name}'] = values
    if session.alignment is not None:
        arrays['|rotation'] = session.alignment.rotation
        arrays['|translation'] = session.alignment.translation
    with replacing(path) as stream:
        np.savez(stream, **arrays)  # type: ignore[arg-type]


def load_session(path: str | Path) -> Session:
    """Read what `save_session` wrote."""
    with np.load(path, allow_pickle=False) as arrays:
        names = list(arrays)
        series = {}
        for topic in {name.split('|')[0] for name in names} - {''}:
            prefix = f'{topic}|values|'
            values = {n[len(prefix) :]: arrays[n] for n in names if n.startswith(prefix)}
            series[topic] = Series(topic, arrays[f'{topic}|stamps'], values)
        alignment = None
        if '|rotation' in names:
            alignment = RigidTransform(arrays['|rotation'], arrays['|translation'])
    return Session('the live buffer', series, None, alignment)
