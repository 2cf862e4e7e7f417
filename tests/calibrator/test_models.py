"""Every method through the common interface, and each one against an independent oracle."""

import json

import numpy as np
import pytest

from calibrator.models import METHODS, make_model, model_from_dict
from calibrator.models.selection import Conditions, _schemes
from calibrator.models.structured import find_period
from stage_core.errors import StageError

QUICK = {
    'perceptron': {'restarts': 1, 'iterations': 200},
    'gaussian_process': {'points': 80},
    'gradient_boosting': {'trees': 30},
    'it2fls': {'particles': 8, 'iterations': 5},
    'hybrid': {'particles': 8, 'iterations': 5},
}


def stage_map(command, direction):
    """A smooth 50 mm stage: scale, squareness, straightness, lead error and backlash."""
    x, y = command.T
    measured = np.empty_like(command)
    turn = 2 * np.pi * x / 0.004
    measured[:, 0] = x * (1 + 2e-4) - 1e-4 * y + 4e-6 * np.sin(turn) + 1e-6 * np.cos(2 * turn)
    measured[:, 1] = y * (1 - 1e-4) + 0.05 * x**2
    return measured + 0.5 * direction * np.array([8e-6, 3e-6])


@pytest.fixture(scope='module')
def samples():
    generator = np.random.default_rng(3)
    command = generator.uniform(-0.025, 0.025, (400, 2))
    direction = generator.choice([-1.0, 1.0], (400, 2))
    measured = stage_map(command, direction) + generator.normal(0, 2e-7, (400, 2))
    return command, measured, direction


@pytest.fixture(scope='module')
def fitted(samples):
    return {name: make_model(name, **QUICK.get(name, {})).fit(*samples) for name in METHODS}


@pytest.mark.parametrize('method', METHODS)
def test_json_round_trip_predicts_the_same_bits(method, fitted, samples):
    command, _, direction = samples
    text = json.dumps(fitted[method].to_dict(), allow_nan=False)
    again = model_from_dict(json.loads(text))
    np.testing.assert_array_equal(
        again.predict(command, direction), fitted[method].predict(command, direction)
    )
    assert method in again.describe()


@pytest.mark.parametrize('method', METHODS)
def test_inverse_reaches_the_wanted_point(method, fitted):
    target = np.random.default_rng(5).uniform(-0.02, 0.02, (40, 2))
    direction = np.ones_like(target)
    model = fitted[method]
    reached = model.predict(model.invert(target, direction), direction)
    # Trees jump, so that only most points have an exact inverse.
    bound = 2e-9 if model.continuous else 5e-6
    assert np.abs(reached - target).max() < bound


@pytest.mark.parametrize('method', [m for m in METHODS if m != 'identity'])
def test_every_method_removes_error_from_held_out_points(method, fitted):
    generator = np.random.default_rng(17)
    command = generator.uniform(-0.023, 0.023, (300, 2))
    direction = generator.choice([-1.0, 1.0], (300, 2))
    truth = stage_map(command, direction)
    before = np.sqrt(np.mean((truth - command) ** 2))
    after = np.sqrt(np.mean((truth - fitted[method].predict(command, direction)) ** 2))
    assert after < (0.05 if method == 'structured' else 0.9) * before


@pytest.mark.parametrize('method', METHODS)
def test_bad_training_data_are_named(method, samples):
    command, measured, direction = samples
    broken = measured.copy()
    broken[7, 1] = np.nan
    with pytest.raises(StageError, match='1 of 400 measured points are not finite'):
        make_model(method).fit(command, broken, direction)
    still = command.copy()
    still[:, 1] = 0.01
    with pytest.raises(StageError, match='axis 1 never moves'):
        make_model(method).fit(still, measured, direction)
    with pytest.raises(StageError, match='shape'):
        make_model(method).fit(command[:-1], measured)
    with pytest.raises(StageError, match='not been fitted'):
        make_model(method).predict(command)
    with pytest.raises(StageError, match='no option colour'):
        make_model(method, colour=1)


@pytest.mark.parametrize('method', [m for m in METHODS if m != 'identity'])
def test_too_few_and_duplicate_points_are_refused(method):
    few = np.array([[0.0, 0.0], [0.01, 0.01]])
    with pytest.raises(StageError, match='2 distinct positions'):
        make_model(method).fit(few, few)
    duplicates = np.tile(few, (200, 1))
    with pytest.raises(StageError, match='2 distinct positions'):
        make_model(method).fit(duplicates, duplicates)


@pytest.mark.parametrize('method', ['polynomial', 'structured', 'hybrid'])
def test_a_shape_that_differs_from_day_to_day_is_not_learned(method):
    generator = np.random.default_rng(4)
    command = np.tile(generator.uniform(0.0, 0.05, (60, 2)), (3, 1))
    day = np.repeat(np.arange(3), 60)
    bow = (command / 0.025 - 1.0) ** 2 * np.array([4e-6, 1e-6, -2e-6])[day][:, None]
    measured = command * (1.0 + 2e-4) + bow + generator.normal(0.0, 1e-7, command.shape)
    degrees = []
    for session in (None, day):
        model = make_model(method).fit(command, measured, session=session)
        state = getattr(model, 'structured', model).state
        degrees.append(np.max(state.get('degrees', model.setting('degree'))))
    # As one session the mean bow of the days is learned.
    assert degrees == [2, 1]


def test_many_sessions_are_left_out_in_few_groups(samples):
    command, measured, direction = samples
    rows = command, measured - command, direction, np.empty((400, 0)), np.arange(400) // 10
    _, sessions = _schemes(Conditions(*rows), 5)
    assert len(sessions) == 8 and (np.sum(sessions, axis=0) == 1).all()


def test_a_sensor_that_drops_out_is_named(samples):
    command, measured, direction = samples
    temperatures = np.full((400, 3), 20.0)
    temperatures[10:20, 2] = np.nan
    with pytest.raises(StageError, match='sensor 2 dropped out in 10 of 400'):
        make_model('structured').fit(command, measured, direction, temperatures)


def test_affine_equals_the_closed_form(samples):
    command, measured, _ = samples
    model = make_model('affine').fit(command, measured)
    design = np.column_stack([command, np.ones(len(command))])
    expected = np.linalg.pinv(design) @ measured
    np.testing.assert_allclose(model.predict(command), design @ expected, atol=1e-14)


def test_polynomial_reproduces_a_polynomial_exactly():
    command = np.random.default_rng(0).uniform(-0.1, 0.3, (200, 2))
    x, y = command.T
    measured = command + np.column_stack([x**3 - 2 * x * y**2, y**5 + x * y])
    model = make_model('polynomial', degree=5).fit(command, measured)
    np.testing.assert_allclose(model.predict(command), measured, atol=1e-14)


def test_structured_recovers_physical_parameters(fitted):
    rows = {(r['axis'], r['name']): r for r in fitted['structured'].parameters()}
    for key, truth in {
        ('x', 'reversal width'): 8e-6,
        ('y', 'reversal width'): 3e-6,
        ('x', 'P1(y)'): -1e-4 * 0.025,
        ('x', 'sin 1/lead'): 4e-6,
        ('x', 'cos 2/lead'): 1e-6,
    }.items():
        row = rows[key]
        assert abs(row['value'] - truth) < max(4 * row['std'], 1e-8), key
        assert 1e-9 < row['std'] < 1e-7
    np.testing.assert_allclose(fitted['structured'].state['leads'][0], 0.004, rtol=1e-3)
    assert fitted['structured'].state['leads'][1] == 0.0


def test_structured_learns_thermal_growth():
    generator = np.random.default_rng(8)
    command = generator.uniform(0.0, 0.2, (500, 1))
    temperature = generator.uniform(18.0, 30.0, (500, 2))
    growth = 11.5e-6 * (temperature[:, :1] - 20.0) * command
    model = make_model('structured', degree=2).fit(
        command, command + growth, temperatures=temperature
    )
    hot = model.predict(np.array([[0.15]]), temperatures=np.array([[28.0, 21.0]]))
    np.testing.assert_allclose(hot, 0.15 + 11.5e-6 * 8.0 * 0.15, atol=1e-9)


@pytest.mark.parametrize('period', [0.61e-3, 2e-3, 5e-3])
def test_period_search_finds_the_lead_and_rejects_noise(period):
    generator = np.random.default_rng(1)
    position = generator.uniform(0, 0.05, 600)
    noise = generator.normal(0, 3e-6, 600)
    line = np.column_stack([np.ones(600), position])
    error = 4e-6 * np.sin(2 * np.pi * position / period) + 1e-3 * position + noise
    assert abs(find_period(position, error, line) - period) < 5e-3 * period
    assert find_period(position, noise, line) == 0.0


@pytest.mark.filterwarnings('ignore:lbfgs failed to converge')
def test_trees_and_perceptron_equal_scikit_learn(samples):
    from sklearn.ensemble import GradientBoostingRegressor
    from sklearn.neural_network import MLPRegressor

    command, measured, _ = samples
    model = make_model('gradient_boosting', trees=20).fit(command, measured)
    x = (command - model.state['centre']) / model.state['half']
    target = (measured - command - model.state['mean']) / model.state['deviation']
    booster = GradientBoostingRegressor(
        n_estimators=20, max_depth=4, subsample=0.7, random_state=0, init='zero'
    ).fit(x, target[:, 1])
    np.testing.assert_allclose(model._predict_scaled(x)[:, 1], booster.predict(x), atol=1e-12)

    model = make_model('perceptron', restarts=1, iterations=20).fit(command, measured)
    network = MLPRegressor(
        hidden_layer_sizes=(10,),
        activation='tanh',
        solver='lbfgs',
        max_iter=20,
        alpha=1e-6,
        random_state=0,
    ).fit(x, target)
    np.testing.assert_allclose(model._predict_scaled(x), network.predict(x), atol=1e-12)


def test_gaussian_process_equals_the_textbook_solution(samples):
    command, measured = (part[:150] for part in samples[:2])
    model = make_model('gaussian_process', points=150).fit(command, measured)
    state = model.state
    x = (command - state['centre']) / state['half']
    target = (measured - command - state['mean']) / state['deviation']
    # Without subsampling, alpha = (K + noise I)^-1 y: the residual is proportional to alpha.
    for output in range(2):
        residual = target[:, output] - model._predict_scaled(x)[:, output]
        noise = residual @ state['weights'][output] / (state['weights'][output] ** 2).sum()
        np.testing.assert_allclose(residual, noise * state['weights'][output], atol=1e-6)


@pytest.mark.parametrize(
    ('method', 'options', 'words'),
    [
        ('polynomial', {'degree': 'x'}, 'degree .* whole number, 0 or more, or "auto"'),
        ('polynomial', {'degree': -3}, 'got -3'),
        ('polynomial', {'degree': 0.5}, 'got 0.5'),
        ('structured', {'degre': 4}, 'did you mean degree'),
        ('structured', {'lead': 'x'}, 'a length per axis'),
        ('structured', {'harmonics': 2}, 'a list of whole numbers'),
        ('it2fls', {'particles': 0}, 'particles .* 1 or more'),
        ('lolimot', {'split_all': 1}, 'true or false'),
        ('gradient_boosting', {'rate': float('nan')}, 'not negative'),
        ('identity', {'degree': 1}, 'it has none'),
    ],
)
def test_an_option_of_another_kind_is_refused(method, options, words):
    with pytest.raises(StageError, match=words):
        make_model(method, **options)
