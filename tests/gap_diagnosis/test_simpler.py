"""One effect in the place of two, and columns that two effects have."""

from __future__ import annotations

import numpy as np

from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.regression import Regression
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.model import Rules
from gap_diagnosis.selection.simpler import merge
from stage_core.arrays import Array
from stage_twin.effects.position_force import KNOTS, force
from stage_twin.effects.term import Term, constant

PULL, RIPPLE = 'position_force.x', 'force_ripple.x'
NOISE = 0.02
TIME = np.arange(0.0, 24.0, 0.01)
PLACE = np.sin(0.9 * TIME)


def _problem(rows: Array, terms: dict[str, Term]) -> Problem:
    rows = rows + NOISE * np.random.default_rng(3).standard_normal(len(rows))
    held, block = TIME % 10.0 > 9.0, (4.0 * TIME).astype(np.int64)
    return Problem(rows, ~held, held, block, TIME, 0 * block, terms, NOISE)


def _pull() -> Term:
    """A force at nine knots, and at all of them in the richer shape."""
    places = np.linspace(-1.0, 1.0, 401)
    units = KNOTS.units(force, places, KNOTS.numbers[-1])
    columns = np.stack([np.interp(PLACE, places, unit) for unit in units], axis=1)
    finest = Term(constant(columns), lambda theta, c: KNOTS.named(c))
    return Term(
        constant(columns[:, : KNOTS.count]),
        lambda theta, c: KNOTS.named(c),
        richer=lambda: finest,
    )


def _ripple(waves: range) -> Term:
    """So many waves over the travel each."""
    angles = np.pi * np.outer(PLACE, waves)
    columns = np.hstack([np.sin(angles), np.cos(angles)])
    return Term(constant(columns), lambda theta, c: {})


def _merged(rows: Array, waves: range) -> list[str]:
    problem = _problem(rows, {PULL: _pull(), RIPPLE: _ripple(waves)})
    selector = Selector(problem, Rules(), 0)
    fit = selector.regression.linear({PULL: (), RIPPLE: ()})
    return merge(selector, [PULL, RIPPLE], fit)[0]


def test_many_waves_beside_a_force_of_the_position_are_what_its_knots_do_not_follow() -> None:
    bump = np.exp(-(((PLACE - 0.3) / 0.15) ** 2))
    assert _merged(bump, range(5, 18)) == [PULL]


def test_one_wave_beside_a_force_of_the_position_is_a_ripple() -> None:
    assert _merged(np.sin(6.0 * np.pi * PLACE), range(6, 7)) == [PULL, RIPPLE]


def test_an_offset_that_two_effects_have_is_that_of_the_session() -> None:
    guide = Term(constant(np.column_stack([PLACE**2, np.ones(len(PLACE))])), lambda theta, c: {})
    frame = Term(constant(np.ones((len(PLACE), 1))), lambda theta, c: {}, nuisances=(0,))
    terms = {'straightness.y': guide, 'tracker_misalignment': frame}
    fit = Regression(_problem(2.0 * PLACE**2 + 0.5, terms)).linear(dict.fromkeys(terms, ()))
    bow, offset = fit.coefficients['straightness.y']
    np.testing.assert_allclose(bow, 2.0, atol=0.01)
    assert offset == 0.0
    np.testing.assert_allclose(fit.coefficients['tracker_misalignment'], 0.5, atol=0.01)
