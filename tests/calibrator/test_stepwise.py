"""Stepwise regression and thermal terms against published runs and independent regressions."""

import numpy as np
import pytest
import statsmodels.api as sm

from calibrator.models import make_model
from calibrator.stepwise import stepwise
from calibrator.thermal import SETS, monomials, thermal_terms, up_to
from stage_core.errors import StageError

# Hald's cement data: heat evolved by composition (Woods, Steinour, Starke 1932), MATLAB's hald.
HALD = np.array(
    [
        [7, 26, 6, 60, 78.5],
        [1, 29, 15, 52, 74.3],
        [11, 56, 8, 20, 104.3],
        [11, 31, 8, 47, 87.6],
        [7, 52, 6, 33, 95.9],
        [11, 55, 9, 22, 109.2],
        [3, 71, 17, 6, 102.7],
        [1, 31, 22, 44, 72.5],
        [2, 54, 18, 22, 93.1],
        [21, 47, 4, 26, 115.9],
        [1, 40, 23, 34, 83.8],
        [11, 66, 9, 12, 113.3],
        [10, 68, 8, 12, 109.4],
    ]
)


def test_documented_hald_runs():
    x, y = HALD[:, :4], HALD[:, 4]
    first = stepwise(x, y)
    assert first.path == (4, 1)
    # Printed in the documentation of MATLAB's stepwisefit.
    np.testing.assert_allclose(first.coefficients[[0, 3]], [1.4400, -0.6140], atol=5e-5)
    second = stepwise(x, y, enter=0.06)
    assert second.path == (4, 1, 2, -4)
    np.testing.assert_allclose(second.coefficients[:2], [1.4683, 0.6623], atol=5e-5)
    assert abs(second.intercept - 52.5773) < 5e-5


@pytest.mark.parametrize('seed', range(3))
def test_selected_model_equals_ordinary_regression_and_is_stable(seed):
    generator = np.random.default_rng(seed)
    x = generator.normal(size=(120, 12)) * 10.0 ** generator.integers(-6, 3, 12)
    x[:, 5] = x[:, 4] * 1.0001 + 1e-3 * np.ptp(x[:, 4]) * generator.normal(size=120)
    y = 3.0 + x[:, [1, 4, 7]] @ (1.0 / x[:, [1, 4, 7]].std(axis=0)) + generator.normal(size=120)
    fit = stepwise(x, y)
    model = sm.OLS(y, sm.add_constant(x[:, fit.selected])).fit()
    np.testing.assert_allclose(fit.coefficients[fit.selected], model.params[1:], rtol=1e-7)
    np.testing.assert_allclose(fit.sigma, np.sqrt(model.mse_resid), rtol=1e-9)
    np.testing.assert_allclose(fit.predict(x), model.fittedvalues, rtol=1e-9)
    assert (model.pvalues[1:] <= 0.10).all()
    for other in set(range(12)) - set(fit.selected):
        more = sm.OLS(y, sm.add_constant(x[:, [*fit.selected, other]])).fit()
        assert more.pvalues[-1] >= 0.05


def test_constant_and_duplicate_columns_do_no_harm():
    generator = np.random.default_rng(4)
    x = generator.normal(size=(50, 3))
    x = np.column_stack([x, x[:, 0], np.full(50, 7.0)])
    fit = stepwise(x, 2 * x[:, 0] + 0.1 * generator.normal(size=50))
    assert len(fit.selected) >= 1 and not {0, 3} <= set(fit.selected) and 4 not in fit.selected
    with pytest.raises(StageError, match='constant'):
        stepwise(x, np.ones(50))
    with pytest.raises(StageError, match='enter <= remove'):
        stepwise(x, x[:, 0], enter=0.2)
    with pytest.raises(StageError, match='not finite'):
        stepwise(np.where(x > 1, np.nan, x), x[:, 1])


def test_three_axes_and_nine_sensors_give_217_terms():
    generator = np.random.default_rng(0)
    q, t = generator.normal(size=(40, 3)), generator.normal(size=(40, 9))
    terms = thermal_terms(q, t, t, t)
    assert [up_to(terms, group).shape[1] for group in SETS] == [19, 28, 199, 217]
    powers = monomials(3)
    assert len(set(powers)) == 19 and {sum(power) for power in powers} == {1, 2, 3}
    geometric, correlated = terms['geometric'].T, terms['correlated'].T
    np.testing.assert_allclose(geometric[powers.index((1, 0, 2))], q[:, 0] * q[:, 2] ** 2)
    by_sensor = correlated.reshape(9, 19, 40)
    np.testing.assert_allclose(by_sensor[4, powers.index((0, 3, 0))], q[:, 1] ** 3 * t[:, 4])


def test_thermal_model_finds_growth_and_warns_outside():
    generator = np.random.default_rng(3)
    command = generator.uniform(0, 0.1, (600, 2))
    heat = generator.uniform(20, 24, (600, 3))
    growth = np.column_stack(
        [
            11e-6 * (heat[:, 0] - 20) * command[:, 0],
            2e-7 * (heat[:, 1] - 20) + 1e-4 * command[:, 1],
        ]
    )
    measured = command + growth + generator.normal(0, 1e-9, (600, 2))
    model = make_model('thermal').fit(command, measured, temperatures=heat)
    error = measured - model.predict(command, temperatures=heat)
    assert np.sqrt(np.mean(error**2)) < 1.3e-9
    target = command[:5]
    found = model.invert(target, temperatures=heat[:5])
    np.testing.assert_allclose(model.predict(found, temperatures=heat[:5]), target, atol=2e-9)
    with pytest.warns(UserWarning, match='lies beyond the calibrated'):
        model.predict(command[:1], temperatures=np.full((1, 3), 60.0))
