"""The baseline for a closed contour: the mean error at each phase of the lap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stage_core.arrays import Array
from stage_core.errors import StageError

#: Bins per lap. An empty one takes the mean of its neighbours.
BINS = 360


class PhaseTable:
    """Mean of measured - command over bins of the angle about the contour's centre."""

    def __init__(self) -> None:
        self.means = np.empty((0, 2))

    def fit(self, command: Array, measured: Array) -> PhaseTable:
        """Learn from points (n, 2) [m] of one or more laps.

        Raises
        ------
        StageError
            If the points have other than two axes.
        """
        if command.shape[1] != 2:
            raise StageError('a phase table needs a contour in two axes')
        index = self._index(command)
        count = np.bincount(index, minlength=BINS)
        total = np.column_stack(
            [np.bincount(index, column, BINS) for column in (measured - command).T]
        )
        filled = np.flatnonzero(count)
        means = total[filled] / count[filled, None]
        at = np.arange(BINS)
        self.means = np.column_stack(
            [np.interp(at, filled, column, period=BINS) for column in means.T]
        )
        return self

    def predict(self, command: Array) -> Array:
        """Measured point of each command, (n, 2) [m]."""
        return command + self.means[self._index(command)]

    def _index(self, command: Array) -> NDArray[np.int64]:
        """Bin of each point about the centre of the points, which may move from day to day."""
        centre = 0.5 * (command.min(axis=0) + command.max(axis=0))
        x, y = (command - centre).T
        turn = (np.arctan2(y, x) + np.pi) / (2.0 * np.pi)
        return np.asarray((turn * BINS).astype(np.int64) % BINS)
