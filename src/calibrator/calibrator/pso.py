"""Particle swarm optimisation (eqs. 25-27 of paper 1) over a batch fitness."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stage_core.errors import StageError

Array = NDArray[np.float64]

CONSTRICTION_INERTIA = 0.7298
CONSTRICTION_ATTRACTION = 1.49618
"""Clerc's and Kennedy's constriction as an inertia weight; the default, see `stability_margin`."""


@dataclass(frozen=True)
class SwarmOptions:
    """Settings of a swarm.

    Attributes
    ----------
    particles, iterations
        The paper's setting is 1000 and 200; 30 and 100 are nearly as good on a stage map.
    inertia, cognitive, social
        w, c_1 and c_2 of eq. 25.
    patience
        Stop after so many iterations without a relative improvement of 1e-4; 0 never stops early.
    seed
        Seed of the generator; a run depends on nothing else.
    """

    particles: int = 30
    iterations: int = 100
    inertia: float = CONSTRICTION_INERTIA
    cognitive: float = CONSTRICTION_ATTRACTION
    social: float = CONSTRICTION_ATTRACTION
    patience: int = 0
    seed: int = 0


@dataclass(frozen=True)
class SwarmResult:
    """Best position (d,), its value, and the best value after each iteration."""

    position: Array
    value: float
    history: Array


def stability_margin(options: SwarmOptions) -> float:
    """Right side minus left side of eq. 27; positive where the paper's condition holds.

    The condition is sufficient and conservative: at w = 0.7298 it allows c_1 + c_2 < 0.169 and
    so forbids the standard, convergent constriction setting.
    """
    w = options.inertia
    return 4.0 * (1.0 - 2.0 * w + w * w) / (1.0 + w) - (options.cognitive + options.social)


def is_constriction(options: SwarmOptions) -> bool:
    """Whether the setting is the order-2 stable region: |w| < 1, c_1 + c_2 < 24(1-w²)/(7-5w)."""
    w = options.inertia
    total = options.cognitive + options.social
    return abs(w) < 1.0 and total < 24.0 * (1.0 - w * w) / (7.0 - 5.0 * w)


def minimise(
    fitness: Callable[[Array], Array],
    low: Array,
    high: Array,
    options: SwarmOptions | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> SwarmResult:
    """Minimise a function over a box.

    Parameters
    ----------
    fitness
        Maps positions (particles, d) to values (particles,); NaN counts as infinitely bad.
    low, high
        The box, (d,) each. A particle that would leave it is put on its edge at rest.
    progress
        Called after each iteration with its number from 1 and the best value so far.

    Raises
    ------
    StageError
        If no particle ever has a finite value, or a setting makes no sense.
    """
    options = options or SwarmOptions()
    _check(options)
    generator = np.random.default_rng(options.seed)
    shape = (options.particles, len(low))
    position = generator.uniform(low, high, shape)
    velocity = generator.uniform(-1.0, 1.0, shape) * 0.1 * (high - low)
    own_position = position.copy()
    own_value = _values(fitness, position)
    leader = int(np.argmin(own_value))
    history = [float(own_value[leader])]
    for iteration in range(1, options.iterations + 1):
        # Independent draws per dimension; one draw per particle explores lines only.
        to_own = options.cognitive * generator.random(shape) * (own_position - position)
        to_best = options.social * generator.random(shape) * (own_position[leader] - position)
        velocity = options.inertia * velocity + to_own + to_best
        position = position + velocity
        velocity[(position < low) | (position > high)] = 0.0
        position = np.clip(position, low, high)
        value = _values(fitness, position)
        better = value < own_value
        own_value[better], own_position[better] = value[better], position[better]
        leader = int(np.argmin(own_value))
        history.append(float(own_value[leader]))
        if progress is not None:
            progress(iteration, history[-1])
        if _rests(history, options.patience):
            break
    if not np.isfinite(history[-1]):
        raise StageError('no particle of the swarm has a finite error: check the training data')
    return SwarmResult(own_position[leader].copy(), history[-1], np.array(history))


def _rests(history: list[float], patience: int) -> bool:
    """Whether none of the last iterations was better than the one before it; 0 never rests."""
    newest = history[-patience - 1 :]
    return 0 < patience < len(history) and all(
        after >= before * (1.0 - 1e-4) for before, after in zip(newest, newest[1:], strict=False)
    )


def _check(options: SwarmOptions) -> None:
    if options.particles < 2 or options.iterations < 1:
        raise StageError('a swarm needs at least 2 particles and 1 iteration')
    if stability_margin(options) <= 0.0 and not is_constriction(options):
        warnings.warn(
            f'inertia {options.inertia} with attraction {options.cognitive + options.social} '
            'meets neither eq. 27 nor the order-2 stability condition: the swarm may diverge',
            stacklevel=3,
        )


def _values(fitness: Callable[[Array], Array], position: Array) -> Array:
    value = np.asarray(fitness(position), dtype=float)
    return np.where(np.isfinite(value), value, np.inf)
