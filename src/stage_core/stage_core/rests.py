"""The finder of rests: a position rests while it stays within a band of where the rest began."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from stage_core.arrays import Array

REFERENCE_BAND = 1e-8
"""A reference within this [m] stands still; encoders and counts have bands of their own."""


class Standstill:
    """The rest in progress of a stream of positions.

    Parameters
    ----------
    band
        Largest distance from where the rest began, per axis [m].

    Attributes
    ----------
    position
        Where the rest began, one number an axis [m]; empty before the first position.
    """

    def __init__(self, band: float) -> None:
        self.band = band
        self.position: tuple[float, ...] = ()

    def moved(self, position: Sequence[float]) -> bool:
        """Take a position (axes,) [m]; whether a new rest begins with it."""
        if len(position) == len(self.position) and all(
            abs(value - began) <= self.band
            for value, began in zip(position, self.position, strict=True)
        ):
            return False
        self.position = tuple(position)
        return True


def find_rests(
    times: Array,
    positions: Array,
    shortest: float,
    band: float = REFERENCE_BAND,
) -> list[tuple[int, int]]:
    """Index ranges [start, stop) of the rests of `positions` (n, axes) [m] at `times` (n,) [s].

    Parameters
    ----------
    shortest
        Least time from the first to the last position of a rest [s], above 0.
    band
        Largest distance from where a rest began, per axis [m].
    """
    rest = Standstill(band)
    starts = [index for index, row in enumerate(positions.tolist()) if rest.moved(row)]
    ranges = pairwise([*starts, len(positions)])
    return [(start, stop) for start, stop in ranges if times[stop - 1] - times[start] >= shortest]
