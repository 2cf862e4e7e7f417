"""Places at which the axes of a stepper stage rest, and what so many of them can tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.input.data import Record
from gap_diagnosis.input.stepper import sides
from stage_core.arrays import Array

#: Share of the travel within which places are one: at its limit switches an axis came to rest
#: within 1.1 % of it.
ONE_PLACE = 0.02
#: Places at which an offset, a scale and a pitch error of any period show together, and one more.
ENOUGH = 6


@dataclass(frozen=True)
class RestPlaces:
    """How many places a session or several have shown at rest.

    Attributes
    ----------
    places : of each axis, by its name
    approaches : of each axis, a place that was reached from both sides counts twice
    numbers : that all places of the table give, one for each axis of each
    """

    places: Mapping[str, int]
    approaches: Mapping[str, int]
    numbers: int

    def few(self) -> list[str]:
        """A sentence for each axis that rested at too few places to tell all effects."""
        return [
            f'axis {axis} rested at {count} places: effects of k parameters show at k + 2 or '
            f'more, all effects together at {ENOUGH}'
            for axis, count in self.places.items()
            if count < ENOUGH
        ]


def rest_places(records: Sequence[Record]) -> RestPlaces | None:
    """Places of the axes that moved; None if the points of a motion count."""
    seen = [r for r in records if r.row_noise is not None]
    if not seen:
        return None
    where = np.concatenate([_at_rests(r, r.encoder) for r in seen])
    side = np.concatenate([_at_rests(r, sides(r.encoder)) for r in seen])
    numbers = np.column_stack([_numbered(own) for own in where.T])
    axes = seen[0].axes
    moved = [i for i in range(len(axes)) if any(r.moving[i] for r in seen)]
    return RestPlaces(
        {axes[i]: _different(numbers[:, i]) for i in moved},
        {axes[i]: _different(numbers[:, i], side[:, i]) for i in moved},
        len(axes) * _different(numbers),
    )


def _at_rests(record: Record, of_ticks: Array) -> Array:
    assert record.tracker_time is not None
    return np.asarray(of_ticks[np.searchsorted(record.time, record.tracker_time)])


def _different(*columns: Array | NDArray[np.int64]) -> int:
    return len(np.unique(np.column_stack(columns), axis=0))


def _numbered(where: Array) -> NDArray[np.int64]:
    """Number of the place, from zero, of each position (n,) [m]; see `ONE_PLACE`."""
    apart, order = ONE_PLACE * float(np.ptp(where)), np.argsort(where)
    numbers, number, start = np.zeros(len(where), np.int64), 0, where[order[0]]
    for k in order:
        if where[k] - start > apart:
            number, start = number + 1, where[k]
        numbers[k] = number
    return numbers
