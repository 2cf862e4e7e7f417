"""Interval type-2 system: type reduction, compiled fitness, consequents and swarm vs oracles."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyit2fls import BMM_algorithm, EIASC_algorithm, KM_algorithm

from calibrator import consequents, pso
from calibrator.it2_sets import AntecedentSets, vector_bounds
from calibrator.models import make_model
from calibrator.swarm_fitness import SwarmFitness, exponential
from calibrator.type_reduction import effective_weights, end_weights
from stage_core.errors import StageError


def random_firing(seed, samples=20, rules=5):
    generator = np.random.default_rng(seed)
    upper = generator.uniform(0.05, 1.0, (samples, rules))
    lower = upper * generator.uniform(0.1, 1.0, (samples, rules))
    return lower, upper, generator.normal(0, 1, (samples, rules))


def interval(lower, upper, outputs):
    """Left and right end of the type-reduced set, (N,) each."""
    ends = end_weights(lower, upper, outputs, exact=True)
    return [np.sum(weights * outputs, axis=1) for weights in ends]


@given(st.integers(0, 10_000), st.integers(1, 7))
@settings(max_examples=25, deadline=None)
def test_exact_interval_equals_brute_force(seed, rules):
    lower, upper, outputs = random_firing(seed, 8, rules)
    left, right = interval(lower, upper, outputs)
    # The extrema of eq. 4 lie at vertices of the box of firing strengths: try all 2^M.
    values = []
    for corner in itertools.product([0, 1], repeat=rules):
        w = np.where(np.array(corner), upper, lower)
        values.append((w * outputs).sum(axis=1) / w.sum(axis=1))
    np.testing.assert_allclose(left, np.min(values, axis=0), atol=1e-12)
    np.testing.assert_allclose(right, np.max(values, axis=0), atol=1e-12)


def test_reductions_equal_an_independent_library():
    lower, upper, outputs = random_firing(1)
    left, right = interval(lower, upper, outputs)
    mixed = np.sum(effective_weights(lower, upper, outputs, 'biglarbegian') * outputs, axis=1)
    for row in range(len(lower)):
        # The library takes intervals [y_l, y_r, w_l, w_r] per rule.
        table = np.column_stack([outputs[row], outputs[row], lower[row], upper[row]])
        for algorithm in (KM_algorithm, EIASC_algorithm):
            np.testing.assert_allclose(algorithm(table.copy()), (left[row], right[row]), atol=1e-9)
        np.testing.assert_allclose(BMM_algorithm(table.copy(), (0.5, 0.5)), mixed[row], atol=1e-12)


def test_maclaurin_reduction_equals_the_printed_equations():
    lower, upper, outputs = random_firing(2)
    weights = effective_weights(lower, upper, outputs, 'maclaurin')
    for w_low, w_up, f, nu in zip(lower, upper, outputs, weights, strict=True):
        delta = w_up - w_low
        over = np.sign(f - (w_up @ f) / w_up.sum())  # eq. 7
        right = (((w_up + w_low) @ f) + (over * delta) @ f) / (  # eq. 6
            (w_up + w_low).sum() + (over * delta).sum()
        )
        under = np.sign(f - (w_low @ f) / w_low.sum())  # eq. 9
        left = (((w_up + w_low) @ f) - (under * delta) @ f) / (  # eq. 8
            (w_up + w_low).sum() - (under * delta).sum()
        )
        np.testing.assert_allclose(nu @ f, 0.5 * (left + right), atol=1e-13)


def test_nie_tan_is_the_mean_strength_and_all_agree_without_uncertainty():
    lower, upper, outputs = random_firing(3)
    nie_tan = effective_weights(lower, upper, outputs, 'nie_tan')
    mean = 0.5 * (lower + upper)
    np.testing.assert_allclose(nie_tan, mean / mean.sum(axis=1, keepdims=True), atol=1e-15)
    type_one = upper / upper.sum(axis=1, keepdims=True)
    for reduction in ('maclaurin', 'karnik_mendel', 'nie_tan', 'biglarbegian'):
        np.testing.assert_allclose(
            effective_weights(upper, upper, outputs, reduction), type_one, atol=1e-14
        )
    with pytest.raises(StageError, match='no type reduction centroid'):
        effective_weights(lower, upper, outputs, 'centroid')


def test_equal_outputs_take_the_mean_strength():
    lower, upper, _ = random_firing(4, samples=3)
    left, right = end_weights(lower, upper, np.full((3, 5), 0.7), exact=False)
    np.testing.assert_allclose(left, right)


def test_firing_far_from_all_rules_stays_finite():
    sets = AntecedentSets(np.zeros((3, 2)), np.full((3, 2), 0.1), np.full((3, 2), 0.01))
    lower, upper = sets.firing(np.array([[80.0, -90.0], [0.0, 0.0]]))
    assert np.isfinite(lower).all() and (lower > 0).all() and (upper >= lower).all()


def test_firing_equals_equations_22_and_23():
    generator = np.random.default_rng(0)
    sets = AntecedentSets.from_vector(generator.uniform(-0.5, 0.0, 30), 5, 2)
    points = generator.uniform(-1, 1, (4, 2))
    lower, upper = sets.firing(points)
    for i, j in itertools.product(range(4), range(5)):
        expected_low = np.prod(np.exp(-(((points[i] - sets.centres[j]) / sets.lower[j]) ** 2)))
        expected_up = np.prod(np.exp(-(((points[i] - sets.centres[j]) / sets.upper[j]) ** 2)))
        strongest = max(
            np.prod(np.exp(-(((points[i] - sets.centres[k]) / sets.upper[k]) ** 2)))
            for k in range(5)
        )
        np.testing.assert_allclose(lower[i, j], expected_low / strongest, rtol=1e-12)
        np.testing.assert_allclose(upper[i, j], expected_up / strongest, rtol=1e-12)


def test_vectorising_exponential_equals_the_librarys():
    exponents = np.concatenate([np.linspace(-60.0, 0.0, 4001), [-0.5, -1e-300]])
    np.testing.assert_allclose([exponential(y) for y in exponents], np.exp(exponents), rtol=3e-13)


def ridge_reference(vector, inputs, targets, rules, reduction):
    """The compiled fitness in plain NumPy: normal equations, one pass of signs."""
    lower, upper = AntecedentSets.from_vector(vector, rules, inputs.shape[1]).firing(inputs)
    plain = 'biglarbegian' if reduction == 'biglarbegian' else 'nie_tan'
    total = 0.0
    for target in targets.T:
        weights = effective_weights(lower, upper, np.zeros_like(lower), plain)
        errors = []
        for _ in range(2 if reduction == 'maclaurin' else 1):
            phi = consequents.regressors(weights, inputs)
            gram = phi.T @ phi
            gram += 1e-10 * np.trace(gram) / len(gram) * np.eye(len(gram))
            theta = np.linalg.solve(gram, phi.T @ target)
            f = consequents.rule_outputs(theta, inputs)
            weights = effective_weights(lower, upper, f, reduction)
            errors.append(np.mean((target - (weights * f).sum(axis=1)) ** 2))
        total += min(errors)
    return total


@pytest.mark.parametrize('reduction', ['maclaurin', 'nie_tan', 'biglarbegian'])
@pytest.mark.parametrize('shape', [(700, 2, 5), (150, 1, 1), (300, 3, 2)])
def test_compiled_fitness_equals_numpy(reduction, shape):
    samples, count, rules = shape
    generator = np.random.default_rng(5)
    inputs = generator.uniform(-1, 1, (samples, count))
    targets = np.column_stack([np.sin(3 * inputs[:, 0]), inputs.sum(axis=1) ** 2])
    targets += generator.normal(0, 0.1, targets.shape)
    low, high = vector_bounds(rules, count)
    # Overlapping sets of medium width: elsewhere a sign hangs on the last digits of a solution
    # that the data barely determine, and two correct programs part ways.
    size = rules * count
    low[size : 2 * size], high[size : 2 * size] = np.log(0.5), np.log(0.9)
    low[2 * size :] = np.log(0.7)
    swarm = generator.uniform(low, high, (12, len(low)))
    one = SwarmFitness(inputs, targets, reduction, threads=1)(swarm)
    expected = [ridge_reference(v, inputs, targets, rules, reduction) for v in swarm]
    np.testing.assert_allclose(one, expected, rtol=1e-6)
    np.testing.assert_array_equal(SwarmFitness(inputs, targets, reduction, 3)(swarm), one)


def test_consequents_recover_a_planted_system():
    generator = np.random.default_rng(6)
    inputs = generator.uniform(-1, 1, (400, 2))
    sets = AntecedentSets(
        generator.uniform(-1, 1, (3, 2)), np.full((3, 2), 0.7), np.full((3, 2), 0.5)
    )
    lower, upper = sets.firing(inputs)
    theta = generator.normal(0, 1, 9)
    outputs = consequents.rule_outputs(theta, inputs)
    target = np.sum(effective_weights(lower, upper, outputs, 'nie_tan') * outputs, axis=1)
    found = consequents.fit_consequents(lower, upper, inputs, target, 'nie_tan')
    np.testing.assert_allclose(found, theta, atol=1e-9)


def test_swarm_finds_the_minimum_and_repeats_with_its_seed():
    def sphere(x):
        return ((x - 0.3) ** 2).sum(axis=1)

    low, high = np.full(6, -1.0), np.full(6, 1.0)
    seen = []
    first = pso.minimise(sphere, low, high, 30, 150, 4, lambda i, best: seen.append((i, best)))
    np.testing.assert_allclose(first, 0.3, atol=1e-4)
    numbers, values = np.array(seen).T
    assert (np.diff(values) <= 0).all() and numbers.tolist() == list(range(1, 151))
    np.testing.assert_array_equal(pso.minimise(sphere, low, high, 30, 150, 4), first)
    edge = pso.minimise(lambda x: x.sum(axis=1), low, high, 30, 150, 4)
    np.testing.assert_allclose(edge, -1.0, atol=1e-6)


def test_a_value_that_is_no_number_is_infinitely_bad():
    low, high = np.zeros(2), np.ones(2)
    found = pso.minimise(lambda x: np.where(x[:, 0] > 0.5, np.nan, -x[:, 0]), low, high)
    assert 0.4 < found[0] <= 0.5
    with pytest.raises(StageError, match='finite'):
        pso.minimise(lambda x: np.full(len(x), np.nan), low, high)


def test_training_reports_progress():
    generator = np.random.default_rng(9)
    command = generator.uniform(0, 0.05, (200, 2))
    measured = command + 1e-5 * np.sin(200 * command)
    model = make_model('it2fls', rules=2, particles=10, iterations=10)
    steps = []
    model.progress = lambda step, value: steps.append(value)
    model.fit(command, measured)
    # The fits with places left out, for the deviation, and the model itself: ten steps each.
    assert len(steps) > 10 and len(steps) % 10 == 0 and steps[-1] <= steps[-10]


def test_karnik_mendel_training_evaluates_the_exact_reduction():
    generator = np.random.default_rng(10)
    command = generator.uniform(0, 0.05, (200, 2))
    measured = command + 1e-5 * np.sin(200 * command)
    model = make_model('it2fls', reduction='karnik_mendel', particles=6, iterations=3)
    model.fit(command, measured)
    inputs, lower, upper = model.firing(command)
    f = consequents.rule_outputs(model.state['theta'][0], inputs)
    left, right = interval(lower, upper, f)
    expected = model.state['mean'][0] + model.state['deviation'][0] * 0.5 * (left + right)
    np.testing.assert_allclose((model.predict(command) - command)[:, 0], expected, atol=1e-15)


def test_hybrid_keeps_the_fuzzy_part_only_where_it_helps():
    generator = np.random.default_rng(11)
    command = generator.uniform(0, 0.05, (200, 2))
    noise = generator.normal(0, 1e-6, (200, 2))
    plain = make_model('hybrid', particles=10, iterations=10)
    plain.fit(command, command * 1.0002 + noise)
    assert not plain.state['fuzzy'] and 'nothing left' in plain.describe()
    bump = 2e-5 * np.exp(-(((command[:, :1] - 0.02) / 0.004) ** 2))
    bent = make_model('hybrid', degree=2, lead=None, particles=30, iterations=40)
    bent.fit(command, command + bump + noise)
    assert bent.state['fuzzy'] and bent.fuzzy.state['rules'] == 5
    left = command + bump - bent.predict(command)
    alone = command + bump - bent.structured.predict(command)
    assert np.std(left) < 0.6 * np.std(alone)
