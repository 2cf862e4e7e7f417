"""What may take the place of an accepted effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.model import Evidence, Rules, Selection
from gap_diagnosis.selection.other_ways import select_best
from gap_diagnosis.selection.rivals import errors_of_stated, find_rivals
from stage_twin.effects.term import Array, Term, constant

ROWS = 4000
TIME = np.linspace(0.0, 0.01 * ROWS, ROWS)
NOISE = 0.1
TRUE, RIVAL = 'coulomb_friction.x', 'viscous_friction.x'
SQUARE, BOW = 'nonorthogonality', 'angular_error.x'


def rivals(target: Array, terms: dict[str, Array]) -> tuple[list[str], list[str]]:
    """Accepted effects, and the alternatives of the first one."""
    rows = np.arange(ROWS)
    noise = np.random.default_rng(1).normal(scale=NOISE, size=ROWS)
    problem = Problem(
        target + noise, rows % 300 < 200, rows % 300 >= 200, rows // 50, TIME,
        np.zeros(ROWS, dtype=np.int64),
        {n: Term(constant(c), lambda theta, k: {}) for n, c in terms.items()}, NOISE,
    )  # fmt: skip
    selector = Selector(problem, Rules(), 0)
    found = select_best(selector)
    find_rivals(selector, found)
    return found.accepted, found.evidence[found.accepted[0]].alternatives


@pytest.mark.parametrize(('unexplained', 'found'), [(0.0, []), (1.0, [RIVAL])])
def test_a_small_loss_tells_unless_models_are_as_wrong(
    unexplained: float, found: list[str]
) -> None:
    """The rival loses 1 % of what the effect explains, 25 times the mean square of the noise.

    A third force that no term follows leaves as much again, or nothing.
    """
    own, other = np.sign(np.sin(TIME)), np.sign(np.sin(3.7 * TIME))
    unknown = unexplained * np.sin(0.9 * TIME)
    columns = {TRUE: own[:, None], RIVAL: (own + 0.1 * other)[:, None]}
    assert rivals(5.0 * own + unknown, columns) == ([TRUE], found)


def test_what_has_the_effect_as_a_special_case_is_no_rival() -> None:
    place = np.sin(TIME)
    columns = {SQUARE: place[:, None], BOW: np.column_stack([place, place**2])}
    assert rivals(5.0 * place, columns) == ([SQUARE], [])


@pytest.mark.parametrize(
    ('gain', 'alternatives', 'errors'),
    [(0.5, [RIVAL], [TRUE]), (0.7, [RIVAL], []), (0.5, [], [])],
    ids=['less than the error', 'more than the error', 'not replaced'],
)
def test_what_other_values_of_a_stated_effect_explain_is_more_than_its_error(
    gain: float, alternatives: list[str], errors: list[str]
) -> None:
    every = np.ones(ROWS, dtype=bool)
    column = Term(constant(np.sin(TIME)[:, None]), lambda theta, k: {})
    terms = {TRUE: column, RIVAL: replace(column, base=np.sin(TIME))}
    problem = Problem(
        np.sin(TIME), every, every, np.arange(ROWS) // 50, TIME,
        np.zeros(ROWS, dtype=np.int64), terms, NOISE, stated=1000.0,
    )  # fmt: skip
    selector = Selector(problem, Rules(of_gap=6e-4), 0)  # 0.6 of the stated squares of 1000
    evidence = Evidence(TRUE, gain, (0.1, 1.0), 1.0, True, alternatives)
    fit = selector.regression.linear({TRUE: ()})
    assert errors_of_stated(selector, Selection([TRUE], fit, {TRUE: evidence}, {})) == errors
