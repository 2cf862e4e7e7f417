"""What explains as much as a name: an offset beside something unknown, and a curve as long."""

from __future__ import annotations

import numpy as np
import pytest

from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.other_ways import select_best
from gap_diagnosis.selection.parts import KINEMATIC_RULES, Part, fit_part
from gap_diagnosis.selection.rivals import find_rivals
from stage_core.arrays import Array
from stage_twin.effects.term import Term, constant

ROWS = 4000
TIME = np.arange(ROWS) * 0.01
NOISE = 1e-6
SCALE, YAW, GUIDE = 'scale_error.x', 'angular_error.x', 'straightness.y'
RESONANCE = 'structural_resonance.x'


def problem(target: Array, terms: dict[str, Term]) -> Problem:
    """One axis, a third of it held out; `target` (n,) [m] without its noise."""
    rows = target + NOISE * np.random.default_rng(5).standard_normal(ROWS)
    held, number = TIME % 5.0 > 3.33, np.zeros(ROWS, np.int64)
    return Problem(rows, ~held, held, TIME.astype(np.int64), TIME, number, terms, NOISE)


def beside_unknown(travel: float) -> Part:
    """A scale error of 8 µm/m at 0.2 m, or its mean alone, beside a mechanism of no name.

    Without a `travel` [m] the scale error is but an offset of 1.6 µm.
    """
    place = 0.2 + max(travel, 0.01) * np.sin(3.1 * TIME)
    error = 8e-6 * place if travel else np.full(ROWS, 1.6e-6)
    term = Term(constant(place[:, None]), lambda theta, c: {'error': float(c[0])})
    unknown = 6e-7 * np.sin(0.5 * TIME)
    return fit_part('tracker', problem(error + unknown, {SCALE: term}), KINEMATIC_RULES, 0, ())


def test_an_offset_beside_something_unknown_is_no_scale_error() -> None:
    part = beside_unknown(0.0)
    assert part.selection.accepted == []
    assert part.structure.structured


def test_a_scale_error_beside_something_unknown_is_named() -> None:
    part = beside_unknown(0.1)
    assert part.selection.accepted == [SCALE]
    assert part.structure.structured


@pytest.mark.parametrize(('size', 'named'), [(4e-7, False), (1.2e-6, True)])
def test_what_swings_is_most_of_what_is_left_beside_something_unknown(
    size: float, named: bool
) -> None:
    swing = np.sin(20.0 * TIME)
    term = Term(constant(swing[:, None]), lambda theta, c: {})
    target = size * swing + 6e-7 * np.sin(0.5 * TIME)
    part = fit_part('tracker', problem(target, {RESONANCE: term}), KINEMATIC_RULES, 0, ())
    assert part.selection.accepted == ([RESONANCE] if named else [])
    assert part.structure.structured


@pytest.mark.parametrize('unknown', [0.0, 6e-7])
def test_a_curve_for_which_nothing_else_speaks_has_to_explain_all(unknown: float) -> None:
    place = np.sin(3.1 * TIME)
    curve = Term(constant((place**2)[:, None]), lambda theta, c: {}, alone=True)
    target = 8e-6 * place**2 + unknown * np.sin(0.5 * TIME)
    part = fit_part('tracker', problem(target, {YAW: curve}), KINEMATIC_RULES, 0, ())
    assert part.selection.accepted == ([] if unknown else [YAW])
    assert part.structure.structured is (unknown > 0.0)


def test_of_two_curves_as_long_the_likelier_one_is_named() -> None:
    # The guide's curve alone beats the yaw's plain shape, and not its rich one.
    place = np.sin(0.5 * TIME)
    other = place + 0.02 * np.cos(3.1 * TIME)
    guide = Term(constant(np.column_stack([other, place**3])), lambda theta, c: {})
    rich = Term(constant(np.column_stack([place, place**3])), lambda theta, c: {})
    yaw = Term(constant(place[:, None]), lambda theta, c: {}, richer=lambda: rich)
    target = 8e-6 * (place - place**3)
    selector = Selector(problem(target, {GUIDE: guide, YAW: yaw}), KINEMATIC_RULES, 0)
    found = select_best(selector)
    find_rivals(selector, found)
    assert found.accepted == [YAW]
    assert found.evidence[YAW].alternatives == [GUIDE]
