"""What may take the place of an accepted effect."""

from __future__ import annotations

import numpy as np
import pytest

from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.model import Rules
from gap_diagnosis.selection.other_ways import select_best
from gap_diagnosis.selection.rivals import find_rivals
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
