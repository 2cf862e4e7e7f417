"""Particle swarm optimisation (eqs. 25-27 of paper 1) over a batch fitness."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stage_core.arrays import Array
from stage_core.errors import StageError

INERTIA = 0.7298
ATTRACTION = 1.49618
"""w and c_1 = c_2 of eq. 25: the constriction of Clerc and Kennedy as an inertia weight.

Eq. 27 as printed, c_1 + c_2 < 4 (1 - w)² / (1 + w), is 0.169 at this w: it forbids this standard
setting, which converges."""


def minimise(
    fitness: Callable[[Array], Array],
    low: Array,
    high: Array,
    particles: int = 30,
    iterations: int = 100,
    seed: int = 0,
    progress: Callable[[int, float], None] | None = None,
) -> Array:
    """Best position (d,) of a swarm that minimises a function over a box.

    Parameters
    ----------
    fitness
        Maps positions (particles, d) to values (particles,); NaN counts as infinitely bad.
    low, high
        The box, (d,) each. A particle that would leave it is put on its edge at rest.
    particles, iterations
        The paper's setting is 1000 and 200; 30 and 100 are nearly as good on a stage map.
    seed
        Seed of the generator; a run depends on nothing else.
    progress
        Called after each iteration with its number from 1 and the best value so far.

    Raises
    ------
    StageError
        If no particle ever has a finite value, or a setting makes no sense.
    """
    if particles < 2 or iterations < 1:
        raise StageError('a swarm needs at least 2 particles and 1 iteration')
    generator = np.random.default_rng(seed)
    shape = (particles, len(low))
    position = generator.uniform(low, high, shape)
    velocity = generator.uniform(-1.0, 1.0, shape) * 0.1 * (high - low)
    own_position = position.copy()
    own_value = _values(fitness, position)
    leader = int(np.argmin(own_value))
    for iteration in range(1, iterations + 1):
        # Independent draws per dimension; one draw per particle explores lines only.
        to_own = ATTRACTION * generator.random(shape) * (own_position - position)
        to_best = ATTRACTION * generator.random(shape) * (own_position[leader] - position)
        velocity = INERTIA * velocity + to_own + to_best
        position = position + velocity
        velocity[(position < low) | (position > high)] = 0.0
        position = np.clip(position, low, high)
        value = _values(fitness, position)
        better = value < own_value
        own_value[better], own_position[better] = value[better], position[better]
        leader = int(np.argmin(own_value))
        if progress is not None:
            progress(iteration, float(own_value[leader]))
    if not np.isfinite(own_value[leader]):
        raise StageError('no particle of the swarm has a finite error: check the training data')
    return own_position[leader].copy()


def _values(fitness: Callable[[Array], Array], position: Array) -> Array:
    value = np.asarray(fitness(position), dtype=float)
    return np.where(np.isfinite(value), value, np.inf)
