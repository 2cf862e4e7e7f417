"""How complex a model the data carry: candidates are judged at what they were not fitted to.

Left out are whole places, whole sessions where there are several, and blocks of time where
temperatures move; never single repeats, which tell nothing about another place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrator.models.domain import Domain
from calibrator.places import distinct_places, folds, judged_places
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.metrics import SIGMAS

Mask = NDArray[np.bool_]

FOLDS, FOLDS_OF_ONE = 5, 10
"""Folds of places to choose among candidates, and where there is one, only its deviation: with
fewer, what is fitted to the rest errs by more than the model."""
MANY = 300
"""From so many conditions on, three folds leave enough for a deviation."""
BLOCKS = 4
"""Blocks of time."""
MOST_SESSIONS = 8
"""More sessions than this are left out in so many groups: each costs a fit of each candidate."""
MOST_JUDGED = 1500
"""More samples than this are thinned to it for the choice."""
EARNED = 0.97
"""A more complex candidate has to lower the left-out RMS to this share: ties go to the simpler."""


@dataclass(frozen=True)
class Conditions:
    """What a model is fitted to: one row per distinct place, direction and temperature.

    command, error, direction (n, axes), temperatures (n, sensors), session (n,).
    """

    command: Array
    error: Array
    direction: Array
    temperatures: Array
    session: NDArray[np.int64]

    def take(self, chosen: Mask | NDArray[np.int64]) -> Conditions:
        """The rows of a mask or index."""
        return Conditions(*(rows[chosen] for rows in vars(self).values()))


SAME_HEAT = 0.1
"""Repeats whose temperatures differ by less than this [K] share a condition."""


def conditions(
    command: Array, error: Array, direction: Array, temperatures: Array, session: Array | None
) -> Conditions:
    """Means of the repeats of every condition, in the order of their first sample."""
    several = np.zeros(len(command)) if session is None else np.asarray(session)
    all_rows = Conditions(command, error, direction, temperatures, several.astype(np.int64))
    place = distinct_places(command)
    if place.max() + 1 == len(command):
        return all_rows
    keys = np.column_stack([place, direction, np.round(temperatures / SAME_HEAT), several])
    _, first, label = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    label = rank[label.reshape(-1)]
    count = np.bincount(label)[:, None]

    def mean(rows: Array) -> Array:
        sums = [np.bincount(label, column) for column in rows.T]
        return np.column_stack(sums) / count if sums else np.empty((len(count), 0))

    order = np.sort(first)
    return Conditions(
        mean(command), mean(error), direction[order], mean(temperatures), all_rows.session[order]
    )


Learner = Callable[[Conditions], Callable[[Conditions], Array]]
"""Fits conditions and returns the predicted error (n, axes) of others."""


def choose(
    candidates: list[dict[str, Any]],
    learner: Callable[[dict[str, Any]], Learner],
    data: Conditions,
) -> tuple[dict[str, Any], Array]:
    """The candidate with the smallest left-out error, simplest first, and its left-out errors.

    Raises
    ------
    StageError
        What the last candidate raised, where none can be fitted.
    """
    if len(data.command) > MOST_JUDGED:
        data = data.take(np.linspace(0, len(data.command) - 1, MOST_JUDGED).astype(int))
    alone = 3 if len(data.command) >= MANY else FOLDS_OF_ONE
    schemes = _schemes(data, FOLDS if len(candidates) > 1 else alone)
    best: tuple[float, dict[str, Any], Array] | None = None
    failure: StageError | None = None
    for candidate in candidates:
        try:
            errors = [_left_out(learner(candidate), data, masks) for masks in schemes]
        except StageError as error:
            failure = error
            continue
        if not any(len(e) for e in errors):
            # So few places that each lies beyond the others: nothing is known but the error.
            errors = [data.error]
        score = float(np.mean([np.mean(e**2) for e in errors if len(e)]))
        if best is None or score < EARNED**2 * best[0]:
            best = score, candidate, np.vstack(errors)
    if best is None:
        assert failure is not None
        raise failure
    return best[1], best[2]


def deviation(left_out: Array) -> Array:
    """Deviation (axes,) [m] whose 95 % interval, 1.96 of it, holds 95 % of the left-out errors.

    Of few errors Student's t is wider, which knows that their scatter is uncertain.
    """
    n = len(left_out)
    # The next error is one more than those that were left out: split conformal prediction.
    level = min(0.95 * (n + 1) / n, 1.0)
    quantile = np.quantile(np.abs(left_out), level, axis=0)
    if n < 40:
        # Only here: it takes a quarter of a second to import.
        from scipy.special import stdtrit

        rms = np.sqrt(np.mean(left_out**2, axis=0))
        wide = rms * stdtrit(max(n - 1, 1), 0.975) * np.sqrt(1.0 + 1.0 / n)
        quantile = np.maximum(quantile, wide)
    return np.asarray(quantile / SIGMAS, dtype=float)


def _schemes(data: Conditions, count: int) -> list[list[Mask]]:
    """Ways to leave out, each a list of masks (n,)."""
    schemes = [folds(judged_places(data.command), count)]
    session = np.unique(data.session, return_inverse=True)[1].reshape(-1)
    if session.max() > 0:
        schemes.append(folds(session, MOST_SESSIONS))
    if data.temperatures.shape[1]:
        block = np.arange(len(data.command)) * BLOCKS // len(data.command)
        schemes.append([block == b for b in range(BLOCKS)])
    return schemes


def _left_out(learn: Learner, data: Conditions, masks: list[Mask]) -> Array:
    """Errors (n, axes) of what each mask leaves out, as far as it lies in the rest's domain.

    A session or a block of time elsewhere in the travel would judge extrapolation, which no model
    does.
    """
    errors = []
    for mask in masks:
        rest, held = data.take(~mask), data.take(mask)
        predict = learn(rest)
        known = Domain.of(rest.command, rest.error, rest.temperatures)
        held = held.take(known.knows(held.command))
        if len(held.command):
            errors.append(held.error - predict(held))
    return np.vstack(errors) if errors else np.empty((0, data.error.shape[1]))
