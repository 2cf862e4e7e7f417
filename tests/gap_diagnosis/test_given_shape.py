"""Whether an effect is there is judged at the shape that was found, its parameters are not."""

from __future__ import annotations

import numpy as np

from gap_diagnosis.evidence.describe import describe, given_shape
from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.regression import Regression
from gap_diagnosis.selection.model import Evidence, Selection
from stage_twin.effects.term import Term

ROWS = 4000
PLACE = np.sin(np.arange(ROWS) * 0.01)
YAW = 'angular_error.x'
SAG = 'torque_sag.x'


def regression(across: float) -> Regression:
    """A yaw of 80 µrad at an arm of 0.1 m, read at places across of this reach [m]."""
    other = across * np.sin(np.arange(ROWS) * 0.037)
    target = 80e-6 * PLACE * (other + 0.1)
    target += 1e-6 * np.random.default_rng(5).standard_normal(ROWS)
    term = Term(
        lambda theta: ((other + theta[0]) * PLACE)[:, None],
        lambda theta, c: {'linear': float(c[0]), 'arm': theta[0]},
        grid=((0.3,),),
        lower=(-1.0,),
        upper=(1.0,),
    )
    number = np.arange(ROWS)
    every = np.ones(ROWS, dtype=bool)
    times = np.asarray(number * 0.01, dtype=np.float64)
    return Regression(
        Problem(target, every, every, number // 100, times, 0 * number, {YAW: term}, 1e-6)
    )


def deviations(across: float) -> tuple[float, float, float]:
    """The yaw, its deviation, and its deviation at the arm that was found [rad]."""
    found = regression(across)
    fit = found.refine({YAW: (0.3,)}, [YAW])
    evidence = {YAW: Evidence(YAW, 1.0, (1.0, 1.0), 1.0, True)}
    selection = Selection([YAW], fit, evidence, {})
    values = describe(selection, found)[YAW]
    given = given_shape(YAW, values, selection, found)
    assert given['arm'] == values['arm']
    assert given['linear'][0] == values['linear'][0]
    return values['linear'][0], values['linear'][1], given['linear'][1]


def test_an_arm_that_is_known_badly_tells_no_yaw() -> None:
    value, whole, given = deviations(5e-4)
    assert given == whole > abs(value)


def test_a_yaw_and_an_arm_that_take_each_others_place_are_stated_without_deviation() -> None:
    value, whole, given = deviations(0.0)
    assert whole == 0.0
    assert 0.0 < given < 0.01 * abs(value)


def test_a_deviation_that_was_surer_elsewhere_stays() -> None:
    found = regression(5e-4)
    fit = found.refine({YAW: (0.3,)}, [YAW])
    selection = Selection([YAW], fit, {YAW: Evidence(YAW, 1.0, (1.0, 1.0), 1.0, True)}, {})
    surest = {'linear': (80e-6, 1e-12), 'arm': (0.1, 1e-3)}
    assert given_shape(YAW, surest, selection, found) == surest


def test_places_far_apart_tell_both() -> None:
    value, whole, given = deviations(0.2)
    assert abs(value - 80e-6) < 4.0 * whole
    assert given == whole < 0.02 * value


def test_ways_that_imitate_one_another_are_told_together() -> None:
    """Two ways that differ by less than the noise: neither is known, their sum is."""
    rng = np.random.default_rng(7)
    ways = np.column_stack([PLACE, PLACE + 1e-4 * np.sin(np.arange(ROWS) * 0.037)])
    target = ways @ [0.02, 0.01] + 1e-3 * rng.standard_normal(ROWS)
    term = Term(
        lambda theta: ways,
        lambda theta, c: {'sag_force': float(c[0]), 'sag_speed': float(c[1])},
    )
    number, every = np.arange(ROWS), np.ones(ROWS, dtype=bool)
    found = Regression(
        Problem(target, every, every, number // 100, number * 0.01, 0 * number, {SAG: term}, 1e-3)
    )
    fit = found.refine({SAG: ()}, [SAG])
    selection = Selection([SAG], fit, {SAG: Evidence(SAG, 1.0, (1.0, 1.0), 1.0, True)}, {})
    values = describe(selection, found)[SAG]
    given = given_shape(SAG, values, selection, found)
    shares = [std / abs(value) for value, std in given.values()]
    assert np.ptp(shares) < 1e-9 and max(shares) < 0.01
    assert all(std > 10.0 * given[key][1] for key, (_, std) in values.items())
