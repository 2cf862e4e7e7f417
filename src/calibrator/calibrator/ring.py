"""A ring of stamped rows: what a running node keeps of a topic."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stage_core.arrays import Array


class Ring:
    """The newest `capacity` rows of numbers with their stamps."""

    def __init__(self, capacity: int, width: int) -> None:
        self._stamps = np.zeros(capacity, dtype=np.int64)
        self._rows = np.zeros((capacity, width))
        self._count = 0

    def __len__(self) -> int:
        return min(self._count, len(self._stamps))

    def add(self, stamp: int, row: Sequence[float]) -> None:
        """Append a row stamped `stamp` [ns]."""
        at = self._count % len(self._stamps)
        self._stamps[at] = stamp
        self._rows[at] = row
        self._count += 1

    def content(self, newest: int | None = None) -> tuple[NDArray[np.int64], Array]:
        """Stamps and rows by time, of the `newest` rows or of all."""
        wanted = len(self) if newest is None else min(newest, len(self))
        at = np.arange(self._count - wanted, self._count) % len(self._stamps)
        at = at[np.argsort(self._stamps[at], kind='stable')]
        return self._stamps[at], self._rows[at]
