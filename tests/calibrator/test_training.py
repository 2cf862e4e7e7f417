"""Preparing samples and training on them, against sessions whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibrator.clock_shift import estimate_shift
from calibrator.compare import compare, table
from calibrator.prepare import approach_direction, prepare, splits
from calibrator.samples import concatenate
from calibrator.thermal import derivatives_at
from calibrator.training import Metrics, stored, train, twin_leads
from stage_bringup.plan import calibration_grid
from stage_core import topics
from stage_core.errors import StageError
from stage_core.session import Series, Session

from .test_zoo import of


@pytest.fixture(scope='module')
def samples(grid_session):
    return prepare(grid_session(120))


def test_rests_give_the_planted_pairs(samples, planted_map):
    assert samples.at_rest and len(samples) == 120
    truth = planted_map(samples.command, samples.direction)
    # 15 tracker points of 0.3 µm each per rest.
    assert np.abs(samples.measured - truth).max() < 5e-7
    assert set(np.unique(samples.direction)) == {-1.0, 1.0}


@pytest.mark.parametrize('latency', [-0.12, 0.0, 0.0373])
def test_clock_shift_is_estimated_from_moving_points(latency, grid_session):
    samples = prepare(grid_session(30, latency=latency))
    assert abs(samples.shift - latency) < 1e-3
    assert len(samples) == 30


@pytest.mark.parametrize('unit', [1.0, 4.7625e-8, None])
def test_travel_of_a_stepper_is_no_clock_shift(unit, grid_session):
    """The reference jumps when a move is sent; counted steps (if known) and tracker follow."""
    session = grid_session(30, rest=0.6)
    motion = session.series[topics.REFERENCE]
    goals = {name: column.copy() for name, column in motion.values.items()}
    still = np.all([np.abs(np.diff(c, append=c[-1])) < 1e-9 for c in goals.values()], axis=0)
    places = np.flatnonzero(still)
    ahead = places[np.minimum(np.searchsorted(places, np.arange(len(still))), len(places) - 1)]
    jumping = {name: column[ahead] for name, column in goals.items()}
    series = dict(session.series)
    series[topics.REFERENCE] = Series(topics.REFERENCE, motion.stamps, jumping)
    if unit is not None:
        counted = {name: column / unit for name, column in motion.values.items()}
        series[topics.JOINT_STATES] = Series(topics.JOINT_STATES, motion.stamps, counted)
    samples = prepare(Session('stepper', series))
    assert abs(samples.shift) < 1e-3
    assert samples.at_rest
    assert np.abs(samples.measured - samples.command).max() < 1e-4


def test_a_session_without_rests_is_a_stream(grid_session, planted_map):
    samples = prepare(grid_session(40, rest=0.0, latency=0.02))
    assert not samples.at_rest and len(samples) > 400
    truth = planted_map(samples.command, samples.direction)
    # A millisecond of shift at 0.3 m/s is 0.3 mm; the estimate must do far better.
    assert np.sqrt(np.mean((samples.measured - truth) ** 2)) < 2e-5


def test_shift_of_a_stage_at_rest_is_zero():
    times = np.arange(100) * 0.01
    still = np.zeros((100, 2))
    assert estimate_shift(times, still, times, still) == 0.0


@given(st.lists(st.sampled_from([-1, 0, 1]), min_size=2, max_size=30))
@settings(max_examples=30, deadline=None)
def test_direction_is_the_last_nonzero_move(moves):
    position = np.concatenate([[0.0], np.cumsum(moves) * 1e-3])[:, None]
    expected, last = [0.0], 0.0
    for move in moves:
        last = float(move) if move else last
        expected.append(last)
    np.testing.assert_array_equal(approach_direction(position)[:, 0], expected)


def test_split_keeps_visits_to_a_position_together(samples):
    twice = concatenate([samples, samples])
    [(training, held)] = splits(twice, seed=3)
    assert len(training) + len(held) == 240
    seen = {tuple(p) for p in training.command}
    assert not any(tuple(p) in seen for p in held.command)
    [(training, held)] = splits(twice, by='time')
    assert training.times.max() <= held.times.min()
    with pytest.raises(StageError, match='by position, time, session or half'):
        splits(twice, by='colour')


def test_few_places_are_each_held_out_once(samples):
    few = samples.take(np.repeat(np.arange(6), 10))
    pairs = splits(few)
    held = [np.unique(part.command, axis=0) for _, part in pairs]
    assert [len(h) for h in held] == [1] * 6 and len(np.unique(np.vstack(held), axis=0)) == 6
    assert all(len(training) == 50 for training, _ in pairs)
    with pytest.raises(StageError, match='4 distinct places'):
        splits(samples.take(np.repeat(np.arange(4), 50)))


def test_a_model_of_one_session_is_not_taken_for_another(samples):
    assert splits(samples, by='session') == []
    rng = np.random.default_rng(5)
    # The second session's stage errs the other way: at unseen places both are half right.
    other = replace(samples, measured=2.0 * samples.command - samples.measured)
    assert len(splits(concatenate([samples, other]), by='session')) == 2
    alike = replace(samples, measured=samples.measured + rng.normal(0.0, 1e-7, (120, 2)))
    good, bad = (train(concatenate([samples, s]), 'affine') for s in (alike, other))
    assert good.gain.proven
    assert bad.gain.left_out and not bad.gain.proven
    places, sessions = bad.line().split('; ')
    assert 'held-out RMS' in places and 'where whole sessions are left out' in sessions
    assert f'after, gain {100 * (1 - bad.after.rms / bad.before.rms):.0f} %' in places


@pytest.mark.parametrize('size', [0.0, 3e-4])
def test_the_drift_of_one_hour_is_no_error_of_the_stage(size):
    rng = np.random.default_rng(4)
    where = calibration_grid(0.03, 5)
    # The zero of x moves by 5 µm while the grid is visited there and back.
    drift = np.column_stack([np.linspace(0.0, 5e-6, len(where)), np.zeros(len(where))])
    error = size * where + drift + rng.normal(0.0, 3e-7, where.shape)
    visits = of(where, error, np.sign(where))
    early, late = (held for _, held in splits(visits, by='half'))
    assert late.times.min() > early.times.max() and len(early) + len(late) == len(visits)
    result = train(visits, 'affine')
    assert result.gain.proven == (size > 0.0)
    assert size > 0.0 or 'where half of the time is left out' in result.line()


@pytest.mark.parametrize('visits', [1, 2])
def test_a_raster_tells_a_drift_apart_only_where_it_is_run_twice(visits):
    lines = np.linspace(-0.03, 0.03, 7)
    raster = np.array([(x, y) for k, y in enumerate(lines) for x in lines[:: 1 - 2 * (k % 2)]])
    where = np.tile(raster, (visits, 1))
    # A perfect stage before a tracker that drifts by 10 µm and 5 µm.
    drift = np.linspace(0.0, 1.0, len(where))[:, None] * [1e-5, 5e-6]
    error = drift + np.random.default_rng(7).normal(0.0, 3e-7, where.shape)
    result = train(of(where, error, np.sign(where)), 'affine')
    once = visits == 1
    assert ('half of the time' in result.line()) != once
    assert ('drift was not told apart' in result.line()) == once
    assert (result.gain.value > 0.5) == once
    assert stored(result, [], 'stage', 1, 1).drift == result.drift


def test_halves_that_share_no_places_judge_nothing():
    x = np.linspace(-0.03, 0.03, 24)
    where = np.column_stack([x, x])  # a diagonal
    error = 5e-5 * (where / 0.03) ** 2 + 3e-4 * where
    noise = np.random.default_rng(6).normal(0.0, 3e-7, where.shape)
    once = of(where, error + noise, np.ones_like(where))
    assert splits(once, by='half') == []
    assert train(once, 'polynomial').gain.proven


def test_half_of_the_places_may_be_too_few_for_the_terms_that_are_asked_for(samples):
    few = samples.take(np.arange(40))
    assert train(few, 'polynomial', {'degree': 5}).gain.left_out == ''


def test_structured_training_reaches_the_noise(samples):
    result = train(samples, 'structured', seed=1)
    assert result.before.rms > 5e-6
    assert result.after.rms < 1.5e-7
    assert '36 held-out of 120 samples' in result.line()
    record = stored(result, [], 'stage', 4, 1)
    assert record.version == 4 and record.metrics['after']['rms'] == result.after.rms


def test_metrics_by_hand():
    metrics = Metrics.of(np.array([[3.0, 0.0], [-1.0, 4.0]]))
    assert metrics == Metrics(np.sqrt(26 / 4), 2.0, 4.0, np.sqrt((4 + 4 + 4 + 4) / 4))


def test_comparison_lists_every_method_and_its_failure(samples):
    few = samples.take(np.arange(20))
    options = {'polynomial': {'degree': 5}}
    results = compare(few, ['identity', 'affine', 'polynomial'], options)
    text = table(results)
    assert text.index('affine') < text.index('identity')
    assert 'record more positions' in text.splitlines()[-1]


def test_temperature_is_used_where_it_moves(grid_session):
    warm = prepare(grid_session(60, sensor=np.linspace(20.0, 26.0, 40)))
    assert warm.sensors == ('screw_x',)
    # It moves, but tells nothing about the error: no model depends on it.
    assert train(warm, 'affine').sensors == train(warm, 'structured').sensors == ()
    steady = prepare(grid_session(60, sensor=[20.0, 20.01]))
    result = train(steady, 'affine')
    assert result.sensors == () and result.model.sensors == 0
    with pytest.raises(StageError, match='sensor screw_x dropped out'):
        prepare(grid_session(20, sensor=[np.nan]))


def warming_session(grid_session, seed, span=2400.0, dropout=False):
    """A session stretched to `span` seconds in which the error follows the warming's rate."""
    session = grid_session(150, seed=seed)
    generator = np.random.default_rng(seed)
    start = session.start_ns
    clock = np.arange(0.0, span, 2.0)
    beat = 2 * np.pi / 2400.0
    heat = 22.0 + 2.0 * np.sin(beat * clock)
    series = {}
    for topic, old in session.series.items():
        stretch = span / ((old.stamps[-1] - start) * 1e-9)
        series[topic] = Series(
            topic, start + ((old.stamps - start) * stretch).astype(np.int64), old.values
        )
    points = series[topics.TRACKER_POINT]
    t = (points.stamps - start) * 1e-9
    grown = {axis: values.copy() for axis, values in points.values.items()}
    # 40 µm at the largest rate; what a lag between sensor and screw looks like.
    grown['x'] += 4e-5 * np.cos(beat * t)
    series[points.topic] = Series(points.topic, points.stamps, grown)
    key = topics.temperature_key('screw_x')
    readings = heat + generator.normal(0.0, 1e-3, len(clock))
    if dropout:
        readings[len(clock) // 2 :] = np.nan
    stamps = start + (clock * 1e9).astype(np.int64)
    series[key] = Series(key, stamps, {'temperature': readings})
    return Session('warming', series)


def test_derivatives_of_irregular_readings_are_those_of_a_parabola():
    generator = np.random.default_rng(0)
    times = np.sort(generator.uniform(0.0, 900.0, 300))
    values = 20.0 + 2e-3 * times + 3e-6 * times**2
    at = np.array([0.0, 350.0, 899.0])
    first, second = derivatives_at(times, values, at)
    ends = np.maximum(at, times[0] + 300.0)
    np.testing.assert_allclose(first, 2e-3 + 6e-6 * ends, rtol=1e-9)
    np.testing.assert_allclose(second, 6e-6, rtol=1e-6)
    # Causal: what comes later does not matter.
    later = np.where(times > 600.0, 99.0, values)
    np.testing.assert_array_equal(derivatives_at(times, later, at[:2])[0], first[:2])
    with pytest.raises(StageError, match='record longer'):
        derivatives_at(times[:50], values[:50], at)


def test_thermal_training_uses_the_derivatives_of_a_bag(grid_session, tmp_path):
    from calibrator.correction import Correction
    from calibrator.live_buffer import save_session
    from calibrator.temperatures import LiveTemperatures
    from calibrator.training_job import Job, run_job

    session = warming_session(grid_session, 1)
    save_session(session, tmp_path / 'live.npz')
    job = Job(out='', live=str(tmp_path / 'live.npz'), method='thermal')
    result, with_rates = run_job(job)
    assert with_rates.model.uses_derivatives and with_rates.sensors == ('screw_x',)
    assert with_rates.model.sensors == 3
    # Alone the temperature tells nothing here: such a model is refused unless it is forced.
    without = run_job(replace(job, options={'derivatives': False}, force=True))[0]
    assert result.after.rms < 0.5 * without.after.rms

    # The live inverse: the same temperature, warming or cooling, asks for another command.
    commands = []
    for at in (0.0, 1200.0):  # sin = 0, rising and falling
        heard, beat = LiveTemperatures(), 2 * np.pi / 2400.0
        clock = at + np.arange(-400.0, 1.0)
        heat = 22.0 + 2.0 * np.sin(beat * clock)
        for k, value in zip(clock, heat, strict=True):
            heard.hear('screw_x', value, 10**12 + int(k * 1e9), 0)
        correction = Correction(1e-3)
        correction.stored = with_rates
        correction.activate(True)
        rates = heard.rates(['screw_x'])
        goal = np.array([0.02, 0.03])
        commands.append(correction.apply(goal, {'screw_x': float(heat[-1])}, rates))
        unknown = correction.apply(goal, {'screw_x': float(heat[-1])})
        assert abs(unknown[0] - commands[-1][0]) > 2e-6
    difference = commands[1][0] - commands[0][0]
    assert abs(difference - 8e-5) < 1.2e-5


def test_thermal_training_names_what_is_missing(grid_session):
    dropped = warming_session(grid_session, 2, dropout=True)
    with pytest.raises(StageError, match='sensor screw_x dropped out'):
        prepare(dropped)
    short = prepare(warming_session(grid_session, 2, span=200.0))
    assert short.rates is None
    assert not train(short, 'thermal').model.uses_derivatives
    with pytest.raises(StageError, match='too short for derivatives'):
        train(short, 'thermal', {'derivatives': True})
    with pytest.raises(StageError, match='no temperature sensor air'):
        short.only(('air',))


def test_missing_topics_and_unknown_quantities_are_named(grid_session):
    session = grid_session(10)
    without = Session('bag', {topics.REFERENCE: session.series[topics.REFERENCE]})
    with pytest.raises(StageError, match='/tracker/point'):
        prepare(without)
    with pytest.raises(StageError, match='got colour'):
        prepare(session, 'colour')
    late = session.series[topics.TRACKER_POINT]
    moved = Series(late.topic, late.stamps + 10**13, late.values)
    with pytest.raises(StageError, match='clocks'):
        prepare(Session('bag', {**session.series, late.topic: moved}))


def test_lead_comes_from_the_nominal_twin(grid_session):
    twin = {'axes': {'x': {'lead': 0.004}, 'y': {'lead': 0.005}}}
    assert twin_leads(grid_session(9, twin=twin)) == [0.004, 0.005]
    assert twin_leads(grid_session(9)) is None


def test_phase_table_is_the_mean_over_laps():
    from calibrator.phase_table import PhaseTable

    turn = np.linspace(-np.pi, np.pi, 3600, endpoint=False) + 1e-4
    circle = 0.1 * np.column_stack([np.cos(turn), np.sin(turn)]) + [0.3, -0.2]
    error = 1e-4 * np.column_stack([np.sin(3 * turn), np.cos(turn)])
    noise = 1e-5 * np.random.default_rng(0).normal(size=error.shape)
    found = PhaseTable().fit(
        np.vstack([circle, circle]), np.vstack([circle + error + noise, circle + error - noise])
    )
    # Bins of one degree: at most 1.5 degrees of the third harmonic off.
    assert np.abs(found.predict(circle) - circle - error).max() < 1e-4 * 3 * np.radians(1.0)
    with pytest.raises(StageError, match='two axes'):
        PhaseTable().fit(circle[:, :1], circle[:, :1])
