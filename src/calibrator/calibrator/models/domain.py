"""Where a model has seen its stage, and what it predicts beyond."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from calibrator.places import MOST_CLUSTERED, distinct_places
from stage_core.arrays import Array
from stage_core.quantities import AXES

MOST_PLACES = 200
"""Places that a domain keeps; of more, those that lie furthest from one another."""
REACH = 2.0
"""A place stands for what lies nearer than this many distances of neighbouring places."""
MOST_ERROR = 2.0
"""No prediction exceeds the largest error seen in training by more than this factor."""

SIGNIFICANT = 3.0
"""A slope of the affine part counts from so many of its standard deviations."""


@dataclass(frozen=True)
class Domain:
    """Places and temperatures of a training, with the affine part of its error.

    Attributes
    ----------
    low, high
        Corners of the travel that was seen, (axes,) [m].
    places
        Where, (p, axes) [m].
    reach
        Distance [m] up to which a place stands for its surroundings.
    coldest, hottest
        Extremes of each temperature column, (sensors,).
    affine
        Least-squares error = [1, command] @ affine, (axes + 1, axes); slopes that the data do not
        show are zero.
    largest
        Largest error seen per axis, (axes,) [m].
    """

    low: Array
    high: Array
    places: Array
    reach: float
    coldest: Array
    hottest: Array
    affine: Array
    largest: Array

    @classmethod
    def of(cls, command: Array, error: Array, temperatures: Array) -> Domain:
        """Domain of training samples."""
        find = _places if len(command) <= MOST_CLUSTERED else _places.__wrapped__
        places, reach = find(command.tobytes(), command.shape)
        centre = command.mean(axis=0)
        half = np.maximum(np.ptp(command, axis=0) / 2.0, 1e-300)
        design = np.column_stack([np.ones(len(command)), (command - centre) / half])
        scaled = np.linalg.lstsq(design, error, rcond=1e-8)[0]
        freedom = max(len(command) - design.shape[1], 1)
        variance = np.sum((error - design @ scaled) ** 2, axis=0) / freedom
        doubt = np.sqrt(np.outer(np.diagonal(np.linalg.pinv(design.T @ design)), variance))
        # A slope that the data do not show is not gone on with.
        scaled[1:][np.abs(scaled[1:]) <= SIGNIFICANT * doubt[1:]] = 0.0
        slope = scaled[1:] / half[:, None]
        return cls(
            command.min(axis=0),
            command.max(axis=0),
            places.copy(),
            reach,
            temperatures.min(axis=0),
            temperatures.max(axis=0),
            np.vstack([scaled[0] - centre @ slope, slope]),
            np.abs(error).max(axis=0),
        )

    def with_error(self, error: Array) -> Domain:
        """The domain after errors (n, axes) [m] were seen in it, which may exceed the former."""
        return replace(self, largest=np.maximum(self.largest, np.abs(error).max(axis=0)))

    def distance(self, command: Array) -> Array:
        """Distance (n,) of points to the nearest place, in reaches: beyond 1 nothing is known."""
        # Only here: it takes a quarter of a second to import.
        from scipy.spatial.distance import cdist

        nearest = cdist(command, self.places).min(axis=1)
        return np.asarray(nearest / max(self.reach, 1e-300), dtype=float)

    def knows(self, command: Array) -> NDArray[np.bool_]:
        """Mask (n,) of the points for which one of the places stands."""
        return np.asarray(self.distance(command) <= 1.0)

    def guard(
        self, error: Callable[[Array, Array], Array], command: Array, temperatures: Array
    ) -> Array:
        """A model's error (n, axes) [m], held at the edge of the domain and faded beyond it.

        Beyond the travel the model keeps the value of its edge and goes on with the affine part;
        between one and two reaches from the nearest place it fades to the affine part, and
        temperatures beyond those seen count as the nearest seen.
        """
        held, heat = self.hold(command, temperatures)
        weight = self.weight(held)[:, None]
        affine = self.affine[0] + held @ self.affine[1:]
        inside = weight * error(held, heat) + (1.0 - weight) * affine
        limit = MOST_ERROR * self.largest
        return np.clip(inside + (command - held) @ self.affine[1:], -limit, limit)

    def hold(self, command: Array, temperatures: Array) -> tuple[Array, Array]:
        """The nearest command of the travel and temperatures that were seen."""
        held = np.clip(command, self.low, self.high)
        if not len(self.coldest):
            return held, temperatures
        return held, np.clip(temperatures, self.coldest, self.hottest)

    def weight(self, command: Array) -> Array:
        """Share (n,) of the model in its prediction; the rest is the affine part."""
        return np.clip(2.0 - self.distance(command), 0.0, 1.0)

    def deviation(self, command: Array, inside: Array) -> Array:
        """Deviation (n, axes) [m] that is `inside` (axes,) in the domain and grows beyond it.

        At two reaches from the nearest place it holds the largest error that was seen.
        """
        outside = np.clip(self.distance(command) - 1.0, 0.0, 1.0)[:, None]
        return np.sqrt(inside**2 + (outside * self.largest) ** 2)

    def beyond(self, command: Array, temperatures: Array) -> str:
        """The first point or temperature beyond the domain, for a person; empty where all lie in.

        Temperatures may be beyond by half of their span: a room is not the same every day.
        """
        far = np.flatnonzero(~self.knows(command))
        if len(far):
            point = ', '.join(f'{1e3 * value:.3f}' for value in command[far[0]])
            travel = ', '.join(
                f'{axis} {1e3 * low:.3f} to {1e3 * high:.3f}'
                for axis, low, high in zip(AXES, self.low, self.high, strict=False)
            )
            return (
                f'({point}) mm lies beyond the calibrated places ({travel} mm): the model holds '
                'its edge there and goes on with the affine part'
            )
        if not len(self.coldest):
            return ''
        span = 0.5 * (self.hottest - self.coldest)
        strange = (temperatures < self.coldest - span) | (temperatures > self.hottest + span)
        if not strange.any():
            return ''
        row, column = np.argwhere(strange)[0]
        return (
            f'temperature {temperatures[row, column]:.4g} lies beyond the calibrated '
            f'{self.coldest[column]:.4g} to {self.hottest[column]:.4g}: the model takes the '
            'nearest of them'
        )


@lru_cache(maxsize=64)  # every candidate of a choice is fitted to the same folds, which are small
def _places(content: bytes, shape: tuple[int, ...]) -> tuple[Array, float]:
    """Places and reach of a domain, of the commands of its training samples."""
    from scipy.spatial.distance import cdist

    command = np.frombuffer(content).reshape(shape)
    visited = np.unique(distinct_places(command), return_index=True)[1]
    places = _spread(command[visited], MOST_PLACES)
    between = cdist(places, places)
    np.fill_diagonal(between, np.inf)
    return places, REACH * float(between.min(axis=1).max()) if len(places) > 1 else 0.0


def _spread(places: Array, most: int) -> Array:
    """At most so many of the places, each the furthest from those before it."""
    if len(places) <= most:
        return places
    chosen = [0]
    distance = np.linalg.norm(places - places[0], axis=1)
    while len(chosen) < most:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return places[chosen]
