"""An optimum that no machine has, and the last possible set on the way to it."""

from __future__ import annotations

import numpy as np

from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.grow import grow
from gap_diagnosis.selection.model import Rules
from gap_diagnosis.selection.possible import refined
from stage_twin.effects.term import Array, Term, Theta

ROWS = 4000
SPEED = np.abs(np.sin(np.arange(ROWS) * 0.011))
FRICTION = 'stribeck_friction.x'


def selector(target: Array, term: Term) -> Selector:
    """One term that may explain a target (n,) beside a small noise."""
    every, number = np.ones(ROWS, dtype=bool), np.arange(ROWS)
    noise = 1e-3 * np.random.default_rng(2).standard_normal(ROWS)
    times = np.asarray(number * 1e-3, dtype=np.float64)
    terms = {FRICTION: term}
    problem = Problem(target + noise, every, every, number // 100, times, 0 * number, terms, 1e-3)
    return Selector(problem, Rules(), 0)


def test_a_friction_that_still_falls_at_the_highest_speed_keeps_a_force_there() -> None:
    falling = Term(
        lambda theta: np.column_stack([np.ones(ROWS), np.exp(-((SPEED / theta[0]) ** 1.5))]),
        lambda theta, c: {'coulomb': float(c[0]), 'breakaway': float(c[1])},
        grid=((0.9,),),
        lower=(0.01,),
        upper=(3.0,),
        admissible=lambda theta, c: bool(min(c) > 0.0),
    )
    found = selector(3.0 - 1.7 * SPEED**1.5, falling)
    best = found.regression.refine({FRICTION: (0.9,)}, [FRICTION])
    assert best.coefficients[FRICTION][0] < 0.0
    edge = refined(found, {FRICTION: (0.9,)}, [FRICTION])
    assert 0.0 < edge.coefficients[FRICTION][0] < 0.6
    assert edge.mean_square(found.problem) < 1e-3 * float(np.mean(found.problem.target**2))


def test_an_impossible_optimum_that_explains_far_more_stays() -> None:
    time = np.arange(ROWS) * 1e-3
    wave = Term(
        lambda theta: np.sin(theta[0] * time)[:, None],
        lambda theta, c: {'coulomb': float(c[0])},
        grid=((10.0,),),
        lower=(1.0,),
        upper=(20.0,),
        admissible=lambda theta, c: theta[0] < 10.1,
    )
    found = selector(np.sin(10.4 * time), wave)
    fit = refined(found, {FRICTION: (10.0,)}, [FRICTION])
    assert abs(fit.thetas[FRICTION][0] - 10.4) < 0.01


def test_a_richer_shape_that_ends_just_beyond_what_machines_have_is_taken() -> None:
    """The fall of the force at speed is all there is; the level beside it comes out below zero."""
    level = 1e-3 * np.ones(ROWS)

    def fall(theta: Theta) -> Array:
        return np.exp(-((SPEED / theta[0]) ** 1.5))[:, None]

    richer = Term(
        lambda theta: np.column_stack([fall(theta), level]),
        lambda theta, c: {'breakaway': float(c[0]), 'coulomb': float(c[1])},
        grid=((0.3,),),
        lower=(0.05,),
        upper=(3.0,),
        admissible=lambda theta, c: bool(min(c) > 0.0),
        own=True,
    )
    plain = Term(
        lambda theta: SPEED[:, None] * theta[0],
        lambda theta, c: {'breakaway': float(c[0])},
        grid=((1.0,),),
        lower=(),
        upper=(),
        richer=lambda: richer,
    )
    found = selector(2.0 * fall((0.4,))[:, 0] - 0.2e-3, plain)
    assert found.regression.linear({FRICTION: (1.0,)}).mean_square(found.problem) > 0.1
    start = found.regression.linear({FRICTION: (1.0,)})
    fit = grow(found, start, [FRICTION])
    assert found.problem.terms[FRICTION] is richer
    assert abs(fit.thetas[FRICTION][0] - 0.4) < 0.01
    assert min(fit.coefficients[FRICTION]) > 0.0
