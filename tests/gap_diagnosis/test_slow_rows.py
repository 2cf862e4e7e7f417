"""Rows of a force balance that count by what is left at their speed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.model import Rules, Selection
from gap_diagnosis.selection.slow_rows import offered, speed_weights
from stage_twin.effects.term import Term

COUNT = 4000
TRUE = 3.0


def creeping(slow: float) -> Problem:
    """Rows of a friction whose slow quarter holds an error of `slow` noises beside it."""
    generator = np.random.default_rng(5)
    speed = np.where(np.arange(COUNT) % 4 == 0, 5e-4, 5e-2)
    sign = np.sign(generator.standard_normal(COUNT))
    error = np.where(speed < 1e-3, slow * sign, 0.0)
    numbers = np.arange(COUNT) // 100
    held_out = numbers % 3 == 0
    name = 'coulomb_friction.x'
    return Problem(
        TRUE * sign + error + generator.standard_normal(COUNT),
        ~held_out,
        held_out,
        numbers,
        0.01 * np.arange(COUNT),
        np.zeros(COUNT, dtype=np.int64),
        {name: Term(lambda _: sign[:, None], lambda theta, c: {'coulomb': float(c[0])})},
        1.0,
        speed=speed,
    )


def selected(problem: Problem) -> Selection:
    """The selection of the problem's only effect."""
    found = Selector(problem.whitened(), Rules(), 0).select()
    assert found.accepted == ['coulomb_friction.x']
    return found


def test_slow_rows_that_leave_more_count_less() -> None:
    problem = creeping(8.0)
    weights = speed_weights(problem, selected(problem))
    assert weights is not None
    slow, fast = (weights[problem.speed == v] for v in (5e-4, 5e-2))
    assert fast == pytest.approx(1.0)
    assert np.all(slow < 0.5)


def test_the_sliding_rows_say_how_large_a_friction_is() -> None:
    problem = creeping(8.0)
    plain = selected(problem)
    weights = speed_weights(problem, plain)
    assert weights is not None
    weighted = selected(problem.weighted(weights))
    errors = [abs(s.fit.coefficients['coulomb_friction.x'][0] - TRUE) for s in (plain, weighted)]
    assert errors[1] < 0.5 * errors[0]


def test_rows_that_leave_alike_count_alike() -> None:
    problem = creeping(0.0)
    assert speed_weights(problem, selected(problem)) is None


def test_rows_count_by_their_speed_beside_a_friction_that_the_twin_states() -> None:
    problem = creeping(8.0)
    nothing = replace(selected(problem), accepted=[])
    assert speed_weights(replace(problem, stated=TRUE**2), nothing) is not None


def test_no_force_along_the_travel_is_new_behind_a_stated_friction() -> None:
    found = selected(creeping(8.0))
    assert offered('force_ripple.x', found)
    behind = replace(found, accepted=['position_force.x'])
    assert offered('position_force.x', behind) and offered('actuation_delay.x', behind)
    assert not offered('force_ripple.x', behind)


def test_without_a_friction_or_a_speed_all_rows_count_alike() -> None:
    problem = creeping(8.0)
    found = selected(problem)
    assert speed_weights(problem, replace(found, accepted=[])) is None
    assert speed_weights(replace(problem, speed=None), found) is None
