"""Which effects are searched beside a set, and in which shape they are tried."""

from __future__ import annotations

import numpy as np
import pytest

from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.model import Rules
from stage_twin.effects.term import Array, Term

ROWS = 4000
NAME = 'force_ripple.x'
TIME = np.arange(ROWS) * 1e-3
START, TRUE = 10.0, 10.4


def wave(grid: float) -> Term:
    """A sine of one frequency, which is searched from a grid of one point."""
    return Term(
        lambda theta: np.sin(theta[0] * TIME)[:, None],
        lambda theta, c: {'amplitude': float(c[0])},
        grid=((grid,),),
        lower=(1.0,),
        upper=(400.0,),
    )


def selector(target: Array, term: Term) -> Selector:
    """One term that may explain a target (n,) beside noise of a tenth."""
    every, number = np.ones(ROWS, dtype=bool), np.arange(ROWS)
    noise = 0.1 * np.random.default_rng(2).standard_normal(ROWS)
    problem = Problem(
        target + noise, every, every, number // 100, TIME, 0 * number, {NAME: term}, 0.1
    )
    return Selector(problem, Rules(), 0)


def test_an_effect_that_explains_something_at_its_start_is_searched() -> None:
    found = selector(np.sin(TRUE * TIME), wave(START))
    trial = found.trials(found.regression.linear({}), [])[NAME]
    assert trial.thetas[NAME][0] == pytest.approx(TRUE, abs=0.02)
    assert found.select().accepted == [NAME]


def test_an_effect_that_explains_nothing_at_its_start_keeps_it() -> None:
    found = selector(np.sin(TRUE * TIME), wave(300.0))
    trial = found.trials(found.regression.linear({}), [])[NAME]
    assert trial.thetas[NAME] == (300.0,)
    assert found.select().accepted == []


def test_a_gain_below_that_of_the_noise_is_enough_to_be_searched() -> None:
    # The start explains less than the noise, and more than the least gain that counts.
    found = selector(0.05 * np.sin(TRUE * TIME), wave(START))
    trial = found.trials(found.regression.linear({}), [])[NAME]
    assert trial.thetas[NAME][0] == pytest.approx(TRUE, abs=0.1)
