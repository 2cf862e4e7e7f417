"""Curves of the travel of which each place was visited once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial.legendre import legval

from gap_diagnosis.residuals.foreseen import variances
from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.regression import Regression
from gap_diagnosis.residuals.uncertainty import uncertainty
from stage_core.arrays import Array
from stage_twin.effects.position_force import KNOTS, force
from stage_twin.effects.shared import ORDERS, roughness
from stage_twin.effects.term import Term, constant

NOISE = 0.02  # of curves of about 1
TIME = np.arange(0.0, 24.0, 0.01)
#: Along the travel of -1 to 1 in twelve steps of two seconds, which are folds.
PATH = (2.0 * (TIME // 2.0) - 11.0) / 12.0 + 0.04 * np.sin(2.0 * np.pi * TIME)


def _problem(rows: Array, columns: Array, rough: Array, seed: int) -> Problem:
    """Rows with noise, and a curve of some columns."""
    term = Term(
        constant(columns),
        lambda theta, c: {f'{k}': value for k, value in enumerate(c.tolist())},
        roughness=rough,
    )
    noise = NOISE * np.random.default_rng(seed).normal(size=len(TIME))
    held = TIME % 10.0 > 9.0
    block, number = (5.0 * TIME).astype(np.int64), np.zeros(len(TIME), dtype=np.int64)
    return Problem(rows + noise, ~held, held, block, TIME, number, {'bend': term}, NOISE)


def _guide(seed: int, larger: float = 1.0) -> tuple[Problem, Array]:
    """A guide as rough as `roughness` takes it to be, beside an offset, or a larger one."""
    rough = np.append(0.0, roughness(2, ORDERS))
    curves = np.delete(np.eye(ORDERS + 1), 1, axis=0)
    columns: Array = np.stack([legval(PATH, one) for one in curves], axis=1)
    usual = 1e-3 / np.sqrt(np.append(1e-5, rough[1:]))
    truth: Array = larger * usual * np.random.default_rng(seed).normal(size=len(usual))
    rows: Array = columns @ truth
    return _problem(rows, columns, rough, seed), truth


def _force(seed: int) -> tuple[Problem, Array]:
    """Two bumps of a force of the position."""
    places = np.linspace(-1.0, 1.0, 401)
    units = KNOTS.units(force, places, KNOTS.numbers[-1])
    columns = np.stack([np.interp(PATH, places, unit) for unit in units], axis=1)
    middles = np.random.default_rng(seed).uniform(-0.7, 0.7, 2)
    rows = np.exp(-(((PATH[:, None] - middles) / 0.25) ** 2)) @ np.array([1.0, -0.7])
    return _problem(rows, columns, KNOTS.roughness(len(units)), seed), middles


@pytest.mark.parametrize('make', [_guide, _force])
def test_they_predict_places_that_no_row_of_a_fit_was_at(
    make: Callable[[int], tuple[Problem, Array]],
) -> None:
    problem, _ = make(1)
    smooth = Regression(problem).linear({'bend': ()})
    any_shape = replace(problem.terms['bend'], roughness=None)
    rough = Regression(replace(problem, terms={'bend': any_shape})).linear({'bend': ()})
    assert smooth.mean_square(problem) < 0.05 * problem.mean_square(problem.judged)
    assert rough.mean_square(problem) > 10.0 * smooth.mean_square(problem)


def test_a_knot_that_no_row_was_near_takes_no_deviation_from_the_others() -> None:
    # 1e-8 in the last column is a row's share of a hat whose foot alone was reached.
    problem, _ = _force(1)
    columns = problem.terms['bend'].columns(()).copy()
    columns[:, -1] = 1e-8
    term = replace(problem.terms['bend'], columns=constant(columns))
    regression = Regression(replace(problem, terms={'bend': term}))
    deviations = uncertainty(regression, regression.linear({'bend': ()}))['bend'][1]
    assert np.all(deviations[: KNOTS.count] > 0.0)


def test_the_errors_of_a_guide_are_as_large_as_their_deviations() -> None:
    errors = []
    for seed in range(20):
        problem, truth = _guide(seed)
        regression = Regression(problem)
        fit = regression.linear({'bend': ()})
        deviations = uncertainty(regression, fit)['bend'][1]
        errors.append((fit.coefficients['bend'] - truth) / deviations)
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.4


def _with_gaps(seed: int) -> Problem:
    """A guide of which two steps are held out: no other row was at their places."""
    problem, _ = _guide(seed, 15.0)
    held = np.isin(TIME // 2.0, (3.0, 8.0))
    return replace(problem, fit=~held, held_out=held)


def test_rows_are_foreseen_as_surely_as_their_errors_are_small() -> None:
    errors, variances = [], []
    for seed in range(80):
        problem = _with_gaps(seed)
        fit = Regression(problem).linear({'bend': ()})
        held = problem.held_out
        assert isinstance(fit.variance, np.ndarray) and np.all(fit.variance[problem.fit] == 1.0)
        errors.append(fit.residual[held] ** 2 / (NOISE**2 * fit.variance[held]))
        variances.append(fit.variance[held])
    assert 0.7 < np.mean(errors) < 1.4
    assert np.median(variances) > 10.0


def test_where_a_curve_was_not_told_no_other_effect_is_told_by_its_error() -> None:
    """An effect that acts at places alone of which the curve knows nothing."""
    gains: list[tuple[float, float]] = []
    for seed in range(10):
        problem = _with_gaps(seed)
        unsure = Regression(problem).linear({'bend': ()})
        error = np.where(problem.held_out, unsure.residual, 0.0)
        other = Term(constant(error[:, None]), lambda theta, c: {}, fixed=True)
        both = replace(problem, terms={**problem.terms, 'other': other})
        fit = Regression(both).linear({'bend': (), 'other': ()})
        squares = np.mean(unsure.residual[problem.judged] ** 2)
        squares -= np.mean(fit.residual[problem.judged] ** 2)
        gains.append((squares, unsure.mean_square(problem) - fit.mean_square(both)))
    by_squares, as_foreseen = np.mean(gains, axis=0)
    assert by_squares > 10.0 * as_foreseen


@pytest.mark.parametrize(('square', 'column'), [(-1e-8, 0.0), (1e-320, 1e-160)])
def test_a_column_of_one_fold_alone_stands_beside_a_curve(square: float, column: float) -> None:
    """What the other folds hold of it is rounding, which may be below zero or next to nothing."""
    rng = np.random.default_rng(1)
    curve = rng.normal(size=(50, 3))
    gram = np.zeros((4, 4))
    gram[:3, :3] = curve.T @ curve
    gram[3, 3] = square
    rows = np.column_stack([curve, np.full(50, column)])
    found = variances(rows, gram, np.array([0.0, 0.1, 0.1, 0.0]), np.ones(4), 1.0)
    assert np.all(np.isfinite(found)) and np.all(found >= 1.0)
