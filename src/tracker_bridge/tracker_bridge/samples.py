"""The one form in which every source hands over a tracker point."""

from __future__ import annotations

from typing import NamedTuple

Point = tuple[float, float, float]


class Sample(NamedTuple):
    """A measured point with the clocks that it passed.

    Attributes
    ----------
    point
        x, y, z in the tracker's frame [m].
    receive_ns
        When it arrived, on the receiver's clock [ns].
    source_ns
        When it was measured, on the source's own clock [ns]; None where the source sends none.
    status
        Status of the point as sent; 0 is good. Others are counted, never published.
    opened_ns
        When the connection was opened that it came by, on the receiver's clock [ns]: it was
        measured after that. 0 where there is none.
    """

    point: Point
    receive_ns: int
    source_ns: int | None = None
    status: int = 0
    opened_ns: int = 0
