"""Rows of a residual with the terms that may explain it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.input.rest_places import RestPlaces
from gap_diagnosis.memory import Memory
from gap_diagnosis.residuals.stands import Stands
from stage_core.arrays import Array
from stage_twin.effects.term import Term

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Problem:
    """Rows of a residual: target (n,), which fit and which are held out, blocks and times.

    `signatures` holds, for effects that are functions of one condition (of the speed, say), a
    general basis (n, k) of that condition: what they leave must not go with it any more.
    """

    target: Array
    fit: Mask
    held_out: Mask
    block: NDArray[np.int64]
    time: Array
    record: NDArray[np.int64]  # number of the session of each row
    terms: dict[str, Term]
    floor: float  # standard deviation of a row's noise, in the target's unit
    crossable: bool = True  # False where the held-out rows are a session of their own
    #: Mean square of the encoders' rounding, of which one row tells the next.
    rounding: float = 0.0
    signatures: dict[str, Callable[[], Array]] = field(default_factory=dict)
    #: Variance of the whole signal of which the target is what the twin leaves: of the force.
    signal: float = 0.0
    #: Mean square of what the twin's own effects need: their models leave a share of it.
    stated: float = 0.0
    #: ρ of rows and columns r_k - ρ r_(k-1), freed of their stands before; None: as they are.
    whitening: float | None = None
    #: Parts of the gap that were taken out of the target before, by their effect.
    before: dict[str, Array] = field(default_factory=dict)
    seams: NDArray[np.int64] | None = None  # rows before which no row of the same series comes
    stands: Stands | None = None  # rows that share an error; None where none do
    speed: Array | None = None  # of the axis at each row (n,) [m/s]; None beyond force balances
    places: RestPlaces | None = None  # at which a stepper rested; None where motion counts
    weights: Array | None = None  # of each row (n,), in rows and columns; None: all alike
    #: What was searched for a set, by all that this depends on: each pass of a selection goes the
    #: way of the last one until a barred effect was taken.
    tried: Memory = field(default_factory=Memory)

    def whiten(self, rows: Array) -> Array:
        """Rows (n,) or (n, k) freed of what their noise shares.

        That of a stand, and a slow remainder: r_k - ρ r_(k-1), zero at the seams.
        """
        if self.whitening is None:
            return rows
        if self.stands is not None:
            rows = self.stands.freed(rows)
        if self.weights is not None:
            rows = rows * self.weights.reshape(-1, *[1] * (rows.ndim - 1))
        if self.whitening == 0.0:
            return rows
        out = rows.copy()
        out[1:] -= self.whitening * rows[:-1]
        if self.seams is not None:
            out[self.seams] = 0.0
        return out

    def weighted(self, weights: Array) -> Problem:
        """The same problem with rows that count by their weights (n,)."""
        kept = self.tried.once(('weights', weights.tobytes()), Memory)
        floor = self.floor * float(np.sqrt(np.mean(weights[self.judged] ** 2)))
        return replace(
            self, weights=weights, target=self.target * weights, floor=floor, tried=kept
        )

    def whitened(self, rho: float = 0.0) -> Problem:
        """The same problem for generalised least squares, with a first-order remainder."""
        other = replace(self, whitening=rho, floor=self.floor * math.sqrt(1.0 + rho**2))
        return replace(other, target=other.whiten(self.target))

    @property
    def gap(self) -> Array:
        """The target (n,) with what was taken out of it before."""
        return self.target + sum(self.before.values())

    @cached_property
    def judged(self) -> Mask:
        """Rows on which a gain is judged (see :class:`Fit`)."""
        return (self.fit | self.held_out) if self.crossable else self.held_out

    @cached_property
    def judged_block(self) -> NDArray[np.int64]:
        """Number of the block of each judged row, from zero."""
        return np.asarray(np.unique(self.block[self.judged], return_inverse=True)[1])

    def mean_square(self, rows: Mask) -> float:
        """Mean square of the unexplained target on some rows."""
        return float(np.mean(self.target[rows] ** 2))
