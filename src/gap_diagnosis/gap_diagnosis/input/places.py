"""Places at which the axes of a stepper stage rest, and what so many of them can tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.input.data import Record

Array = NDArray[np.float64]

#: Share of the travel within which places are one: at its limit switches an axis came to rest
#: within 1.1 % of it.
ONE_PLACE = 0.02
#: Places at which an offset, a scale, a play and a pitch error of any period show together.
ENOUGH = 7


def rest_places(records: Sequence[Record]) -> dict[str, int]:
    """Number of places at which each axis rested, by its name; empty if points in motion count.

    Under the empty name it is that of the numbers which all places of the table give.
    """
    seen = [r for r in records if r.row_noise is not None]
    if not seen:
        return {}
    axes = seen[0].axes
    where = np.concatenate([r.encoder_at(r.tracker_time) for r in seen])
    numbers = np.column_stack([_numbered(own) for own in where.T])
    places = dict(zip(axes, (numbers.max(axis=0) + 1).tolist(), strict=True))
    return {**places, '': len(axes) * len(np.unique(numbers, axis=0))}


def few_places(records: Sequence[Record]) -> list[str]:
    """A sentence for each axis that moved and rested at too few places to tell all effects."""
    moving = {a for r in records for a, moved in zip(r.axes, r.moving, strict=True) if moved}
    return [
        f'axis {axis} rested at {count} places: effects of k parameters show at k + 2 or more, all '
        f'effects together at {ENOUGH}'
        for axis, count in rest_places(records).items()
        if count < ENOUGH and axis in moving
    ]


def _numbered(where: Array) -> NDArray[np.int64]:
    """Number of the place, from zero, of each position (n,) [m]; see `ONE_PLACE`."""
    apart, order = ONE_PLACE * float(np.ptp(where)), np.argsort(where)
    numbers, number, start = np.zeros(len(where), np.int64), 0, where[order[0]]
    for k in order:
        if where[k] - start > apart:
            number, start = number + 1, where[k]
        numbers[k] = number
    return numbers
