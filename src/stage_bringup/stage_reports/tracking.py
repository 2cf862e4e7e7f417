"""What a session measured: errors of a moving stage, places at rest, runs of a contour."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from calibrator.prepare import prepare
from stage_core import topics
from stage_core.arrays import Array
from stage_core.clocks import to_seconds
from stage_core.errors import StageError
from stage_core.session import Session

#: A stage position beyond this (m) is not in metres: a stepper's joint states are motor steps.
LONGEST_STAGE = 20.0
#: A pause this long (s) between two contour errors separates two runs of the contour.
PAUSE = 0.1


@dataclass(frozen=True)
class Tracking:
    """Errors of a session at the instants of one sensor; arrays (n,) s and (n, axes) m."""

    sensor: str
    seconds: Array
    reference: Array
    measured: Array
    errors: Array = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'errors', self.reference - self.measured)

    def take(self, chosen: NDArray[np.bool_]) -> Tracking:
        """The instants of a mask (n,)."""
        return replace(
            self,
            seconds=self.seconds[chosen],
            reference=self.reference[chosen],
            measured=self.measured[chosen],
        )


def tracking_errors(session: Session) -> list[Tracking]:
    """Reference minus encoder and reference minus tracker, those that the session has."""
    if not session.has(topics.REFERENCE):
        return []
    found = []
    if session.has(topics.JOINT_STATES):
        measured = session.series[topics.JOINT_STATES].columns('position', session.axes)
        stepper = bool(session.twin) and (session.twin or {}).get('kind') == 'stepper'
        if not stepper and np.abs(measured).max() < LONGEST_STAGE:
            found.append(('encoder', session.seconds(topics.JOINT_STATES), measured))
    if session.has(topics.TRACKER_POINT):
        points = session.table_points()[:, : len(session.axes)]
        found.append(('tracker', session.seconds(topics.TRACKER_POINT), points))
    result = []
    for sensor, seconds, measured in found:
        reference = _reference_at(session, seconds)
        known = np.isfinite(reference).all(axis=1)
        if known.sum() >= 8:
            result.append(Tracking(sensor, seconds[known], reference[known], measured[known]))
    return result


def _reference_at(session: Session, seconds: Array) -> Array:
    """Reference positions (n, axes) at the given times; NaN outside the reference."""
    series = session.require(topics.REFERENCE, 'says where the stage should be')
    times = session.seconds(topics.REFERENCE)
    columns = series.columns('position', session.axes)
    return np.column_stack(
        [np.interp(seconds, times, column, left=np.nan, right=np.nan) for column in columns.T]
    )


@dataclass(frozen=True)
class Places:
    """Rests of a session: wanted and measured table positions (n, axes) m.

    `direction` (n, axes) is the sign of each axis' last move.
    """

    wanted: Array
    measured: Array
    direction: Array

    @property
    def errors(self) -> Array:
        """Measured minus wanted, (n, axes) m."""
        return self.measured - self.wanted


def places(session: Session) -> Places | None:
    """Where the tracker saw the table at rest; None for a session without enough rests."""
    if not session.has(topics.REFERENCE) or not session.has(topics.TRACKER_POINT):
        return None
    try:
        samples = prepare(session)
    except StageError:
        return None
    if not samples.at_rest:
        return None
    return Places(samples.command, samples.measured, samples.direction)


@dataclass(frozen=True)
class Run:
    """One run of a contour: when (s), and at each of its ticks the contour error (n,) m.

    `errors` (n, 2) m are the reference of a tick minus its encoder reading. The driver's own
    reference is a tick late in real time, which is 30 µm at 30 mm/s.
    """

    number: int
    seconds: Array
    contour: Array
    errors: Array

    def within(self, seconds: Array) -> NDArray[np.bool_]:
        """Which instants (n,) s lie in the run."""
        return (seconds >= self.seconds[0]) & (seconds <= self.seconds[-1])


def runs(session: Session) -> list[Run]:
    """The runs of a contour in a session, told apart by the pauses between them.

    The contour controller publishes an error only while it follows the contour: neither the
    approach nor the way back is part of a run.
    """
    if not session.has(topics.CONTOUR_ERROR):
        return []
    series = session.series[topics.CONTOUR_ERROR]
    seconds = to_seconds(series.stamps, session.start_ns)
    cuts = np.flatnonzero(np.diff(seconds) > PAUSE) + 1
    errors = np.column_stack([series.values[axis] for axis in 'xyz'])
    parts = zip(np.split(seconds, cuts), np.split(errors, cuts), strict=True)
    return [
        Run(number, part, error[:, 2], error[:, :2])
        for number, (part, error) in enumerate(parts, 1)
        if len(part) >= 8
    ]
