"""Recursive least squares against the batch solution, and the guard of the adaptation."""

import numpy as np
import pytest

from calibrator.adaptation import LiveAdaptation
from calibrator.live_buffer import LiveBuffer
from calibrator.model_file import StoredModel
from calibrator.models import make_model
from calibrator.online import OnlineAdapter, RecursiveLeastSquares
from calibrator.prepare import prepare
from stage_core.errors import StageError

from .hearing import hear


def test_recursion_equals_batch_ridge_with_exponential_weights():
    generator = np.random.default_rng(0)
    x, y = generator.normal(size=(60, 4)), generator.normal(size=60)
    start, forgetting = generator.normal(size=4), 0.97
    rls = RecursiveLeastSquares(start, np.ones(4), 2.0, 0.5, forgetting)
    for row, value in zip(x, y, strict=True):
        rls.update(row, value)
    weights = forgetting ** np.arange(59, -1, -1)
    prior = forgetting**60 * (0.5 / 2.0) ** 2 * np.eye(4)
    batch = np.linalg.solve(prior + (x.T * weights) @ x, prior @ start + (x.T * weights) @ y)
    np.testing.assert_allclose(rls.weights, batch, rtol=1e-9)


def test_covariance_does_not_wind_up_at_one_place():
    rls = RecursiveLeastSquares(np.zeros(3), np.ones(3), 1.0, 1.0, 0.9)
    for _ in range(2000):
        rls.update(np.array([1.0, 0.0, 0.0]), 1.0)
    assert np.trace(rls.covariance) < 1e5 and abs(rls.weights[0] - 1.0) < 1e-6


def base(method, **options):
    generator = np.random.default_rng(1)
    command = generator.uniform(0, 0.05, (300, 2))
    measured = command + 2e-5 * np.sin(60 * command) + generator.normal(0, 2e-7, (300, 2))
    return make_model(method, **options).fit(command, measured)


@pytest.mark.parametrize(
    ('method', 'options'),
    [
        ('structured', {'degree': 3}),
        ('affine', {}),
        ('it2fls', {'rules': 2, 'particles': 10, 'iterations': 10}),
    ],
)
def test_design_and_weights_reproduce_the_prediction(method, options):
    model = base(method, **options)
    points = np.random.default_rng(2).uniform(0, 0.05, (20, 2))
    for axis, (design, offset) in enumerate(model.linear_design(points)):
        expected = (model.predict(points) - points)[:, axis]
        np.testing.assert_allclose(
            design @ model.linear_weights()[axis] + offset, expected, atol=1e-15
        )


@pytest.mark.parametrize('method', ['structured', 'affine'])
def test_drift_of_a_warming_stage_is_followed(method):
    model = base(method, **({'degree': 3} if method == 'structured' else {}))
    adapter = OnlineAdapter(model, deviation=5e-6, noise=3e-7, forgetting=0.97)
    generator = np.random.default_rng(3)
    late = []
    for k in range(600):
        command = generator.uniform(0, 0.05, (1, 2))
        drift = 4e-4 * k / 600 * command + 5e-6 * k / 600
        measured = model.predict(command) + drift + generator.normal(0, 2e-7, (1, 2))
        if k > 500:
            late.append([(measured - m.predict(command))[0] for m in (adapter.model, model)])
        adapter.update(command, measured)
        # Four places prove nothing.
        assert k > 3 or adapter.in_use is model
    assert adapter.in_use is adapter.model
    adapted, frozen = np.sqrt(np.mean(np.square(late), axis=(0, 2)))
    assert frozen > 1e-5 and adapted < 0.1 * frozen


def test_bad_measurements_are_rolled_back():
    model = base('affine')
    adapter = OnlineAdapter(model, deviation=1e-4, noise=1e-7, forgetting=0.9)
    generator = np.random.default_rng(4)
    for k in range(400):
        command = generator.uniform(0, 0.05, (1, 2))
        measured = model.predict(command)
        # A reflector that is knocked now and then; the held-out samples stay good.
        if k % 5 != 4 and k % 3 == 0:
            measured = measured + generator.normal(0, 2e-4, (1, 2))
        adapter.update(command, measured)
    assert adapter.rollbacks >= 3
    points = generator.uniform(0, 0.05, (50, 2))
    assert np.abs(adapter.kept.predict(points) - model.predict(points)).max() < 2e-5


def test_grossly_bad_measurements_are_rolled_back_at_once():
    model = base('affine')
    adapter = OnlineAdapter(model, deviation=1e-4, noise=1e-6, forgetting=0.97)
    generator = np.random.default_rng(5)
    points = generator.uniform(0, 0.05, (50, 2))
    for k in range(1, 16):
        command = generator.uniform(0, 0.05, (1, 2))
        bad = k % 5 != 0
        proven = adapter.proven
        adapter.update(command, model.predict(command) + (3e-4 if bad else 0.0))
        if adapter.rollbacks:
            break
    assert k == 10
    np.testing.assert_array_equal(adapter.model.predict(points), model.predict(points))
    # Those points agreed with one another, and proved a gain that is not there.
    assert proven and not adapter.proven


def test_what_was_proven_is_in_use_again_after_a_rollback():
    model = base('affine')
    adapter = OnlineAdapter(model, deviation=1e-4, noise=1e-6, forgetting=0.97)
    generator = np.random.default_rng(7)
    points = generator.uniform(0, 0.05, (50, 2))
    for k in range(1, 81):
        command = generator.uniform(0, 0.05, (1, 2))
        # The stage is off by 20 µm; from the 41st rest on, what can be learned is off by more.
        bad = generator.normal(0, 2e-4, (1, 2)) if k > 40 and k % 5 else 0.0
        adapter.update(command, model.predict(command) + 2e-5 + bad)
        if adapter.rollbacks:
            break
    assert 40 < k < 80
    assert adapter.in_use is adapter.model
    np.testing.assert_allclose(
        adapter.in_use.predict(points), model.predict(points) + 2e-5, atol=1e-7
    )


def test_wild_points_are_refused_and_a_jump_of_the_stage_is_followed():
    model = base('affine')
    adapter = OnlineAdapter(model, deviation=5e-6, noise=1e-6, forgetting=0.9)
    generator = np.random.default_rng(6)
    points = generator.uniform(0, 0.05, (50, 2))
    for k in range(1, 41):
        command = generator.uniform(0, 0.05, (1, 2))
        wild = 2e-4 if k % 3 == 0 and k % 5 else 0.0
        adapter.update(command, model.predict(command) + wild)
    assert adapter.refused == 11 and adapter.learned == 40 - 8 - 11
    np.testing.assert_allclose(adapter.model.predict(points), model.predict(points), atol=1e-12)
    for _ in range(60):
        command = generator.uniform(0, 0.05, (1, 2))
        adapter.update(command, model.predict(command) + 2e-4)
    np.testing.assert_allclose(
        adapter.model.predict(points), model.predict(points) + 2e-4, atol=2e-6
    )
    for _ in range(10):
        adapter.update(points[:1], np.full((1, 2), np.nan))
    assert np.isfinite(adapter.model.predict(points)).all()


def test_methods_without_linear_weights_are_refused():
    with pytest.raises(StageError, match='no linear weights'):
        OnlineAdapter(base('lolimot'), 1e-6, 1e-6, 0.99)
    with pytest.raises(StageError, match='forgetting'):
        RecursiveLeastSquares(np.zeros(1), np.ones(1), 1.0, 1.0, 1.5)


def test_live_rests_are_learned_once_and_followed(grid_session, planted_map):
    cold = prepare(grid_session(80, seed=1))
    model = make_model('structured', degree=2).fit(
        cold.command, cold.measured - 4e-6, cold.direction
    )
    session = grid_session(80, seed=2)
    adaptation = LiveAdaptation(StoredModel(model), 5e-6, 5e-7, 0.98)
    buffer = LiveBuffer(100_000)
    # Silent ever since, and none of the model's.
    buffer.temperatures.hear('air', 20.0, session.start_ns - 100 * 10**9, 0)
    learned = 0
    for k in hear(buffer, session):
        if k % 2000 == 1999:
            learned += adaptation.step(buffer)
    # What is in use stays as it was taken, whatever is learned meanwhile.
    taken = adaptation.stored.model
    points = cold.command[:5]
    before = taken.predict(points)
    adaptation.adapter.update(points[:1], points[:1] + 1e-5, np.ones((1, 2)))
    np.testing.assert_array_equal(taken.predict(points), before)
    assert taken is not model and adaptation.adapter.proven
    assert 60 <= learned + adaptation.step(buffer) <= 80
    assert adaptation.step(buffer) == 0
    warm = prepare(grid_session(40, seed=3))
    truth = planted_map(warm.command, warm.direction)

    def rms(m):
        return np.sqrt(np.mean((truth - m.predict(warm.command, warm.direction)) ** 2))

    assert rms(adaptation.stored.model) < 0.6 * rms(model)


def adapt_along_x(model, rests, monkeypatch, sensors=()):
    """A stage of 10 µm play that rests for so many seconds along x, after a move of y."""
    monkeypatch.setattr('calibrator.adaptation.NEWEST', 600)
    generator = np.random.default_rng(1)
    adaptation = LiveAdaptation(StoredModel(model, sensors=sensors), 5e-6, 5e-7, 0.98)
    buffer, stamp, at = LiveBuffer(100_000), 0, np.array([0.01, 0.04])

    def put(goal, count):
        nonlocal stamp, at
        sign = np.where(goal != at, np.sign(goal - at), put.sign)
        for share in np.linspace(0.0, 1.0, count):
            stamp += 10_000_000
            now = at + share * (goal - at)
            buffer.add_reference(stamp, ('x', 'y'), tuple(now))
            table = now + 0.5e-5 * sign + generator.normal(0.0, 3e-7, 2)
            buffer.add_point(stamp, (*table, 0.0))
        at, put.sign = goal, sign

    put.sign = np.zeros(2)
    put(np.array([0.01, 0.05]), 20)
    for count in rests:
        put(np.array([generator.uniform(0.01, 0.09), 0.05]), 20)
        for _ in range(count):
            put(at, 100)
            adaptation.step(buffer)
    return adaptation


def playing(warm=False):
    """A model of a stage with 10 µm play, and with a growing screw where it is warm."""
    generator = np.random.default_rng(0)
    command = generator.uniform(0.0, 0.1, (200, 2))
    direction = generator.choice([-1.0, 1.0], (200, 2))
    heat = generator.uniform(20.0, 24.0, (200, 1)) if warm else None
    growth = 2e-5 * (heat - 20.0) * command if warm else 0.0
    measured = command + growth + 0.5e-5 * direction
    return make_model('structured', degree=1).fit(command, measured, direction, heat)


def test_the_direction_of_an_axis_that_stands_for_long_is_known(monkeypatch):
    model = playing()
    adaptation = adapt_along_x(model, [1] * 60, monkeypatch)
    assert 45 <= adaptation.adapter.learned <= 60 and adaptation.adapter.refused == 0
    at, back = np.array([[0.05, 0.05]]), -np.ones((1, 2))
    np.testing.assert_allclose(
        adaptation.adapter.model.predict(at, back), model.predict(at, back), atol=5e-7
    )


def test_a_long_rest_is_learned_once(monkeypatch):
    # Rests of 4 s and 40 s; the buffer that is looked through holds 6 s.
    adaptation = adapt_along_x(playing(), [4, 4, 40, 4, 4], monkeypatch)
    adapter = adaptation.adapter
    assert adapter.learned + len(adapter._judged) + adapter.refused == 4


def test_nothing_is_learned_while_a_sensor_of_the_model_is_unheard(monkeypatch):
    with pytest.raises(StageError, match='no temperature sensor screw_x'):
        adapt_along_x(playing(warm=True), [1] * 4, monkeypatch, ('screw_x',))


def test_a_clock_that_is_set_back_begins_a_session(grid_session):
    buffer = LiveBuffer(100_000)
    adaptation = LiveAdaptation(StoredModel(playing()), 1e-4, 1e-6, 0.98)
    learned = []
    for seed in (1, 2):
        # The stamps of both sessions begin at the same second.
        session = grid_session(10, rest=0.2, seed=seed)
        for k in hear(buffer, session):
            if k == 1000:
                adaptation.step(buffer)
        learned.append(adaptation.step(buffer))
        np.testing.assert_array_equal(
            prepare(buffer.session()).measured, prepare(session).measured
        )
    assert min(learned) > 3
