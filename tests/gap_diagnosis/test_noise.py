"""What a record holds beside the motion: points between ticks, noise, jitter, units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.experiment.machine import session as run_of
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.evidence.acceptance import far_from_explained
from gap_diagnosis.input import coarse
from gap_diagnosis.input.data import load_record
from gap_diagnosis.input.noise import (
    Noise,
    Sampling,
    axis_noise,
    encoder_step,
    jitter_finding,
    sampling_jitter,
)
from gap_diagnosis.report.document import as_dict
from gap_diagnosis.residuals.regression import Regression
from gap_diagnosis.residuals.servo import Servo
from gap_diagnosis.residuals.uncertainty import uncertainty
from gap_diagnosis.result import Diagnosis
from stage_core import topics
from stage_core.session import Series, Session
from stage_core.twin_file import TrackerSpec, TwinFile

from .conftest import nominal, reference

Maker = Callable[..., Session]


def on_circles(session: Session, latency: float, drift: float = 0.0) -> Session:
    """The session as if its axes ran circles with the tracker late, its ticks exact."""
    series = dict(session.series)
    stamps = series[topics.REFERENCE].stamps
    start, seconds = stamps[0], (stamps - stamps[0]) * 1e-9

    def circle(t: np.ndarray) -> np.ndarray:
        angle = 2.0 * np.pi * (0.5 * t + 0.02 * t**2)
        return 0.03 * np.column_stack([np.cos(angle), np.sin(angle)])

    joints = circle(seconds)
    for key in (topics.REFERENCE, topics.JOINT_STATES):
        values = dict(series[key].values)
        values |= {f'position.{axis}': joints[:, i] for i, axis in enumerate('xy')}
        series[key] = Series(key, stamps, values)
    tracker = series[topics.TRACKER_POINT]
    true = (tracker.stamps - start) * 1e-9 / (1.0 + drift) - latency
    x, y = circle(true).T
    values = {'x': x, 'y': y, 'z': np.zeros_like(x)}
    series[topics.TRACKER_POINT] = Series(topics.TRACKER_POINT, tracker.stamps, values)
    return replace(session, series=series)


@pytest.mark.parametrize(('latency', 'drift'), [(5e-3, 0.0), (-0.011, 0.0), (0.0, 2e-4)])
def test_points_that_are_late_on_a_circle_are_no_rotation(
    planted: Maker, latency: float, drift: float
) -> None:
    session = on_circles(planted({}, axes=('x', 'y'), duration=10.0), latency, drift)
    record = load_record(session, TwinFile.nominal_servo())
    found = coarse.find([record])
    assert found.angle == 0.0 and found.offset == (0.0, 0.0)
    assert found.latency == pytest.approx(latency, abs=1e-4)
    assert found.drift == pytest.approx(drift, abs=2e-5)


@pytest.mark.parametrize('barred', coarse.MOVED)
def test_what_is_no_candidate_is_not_taken_out(barred: str) -> None:
    found = coarse.Coarse(0.01, (0.1, 0.2), 3e-3, 1e-4)
    assert set(found.effects) == set(coarse.MOVED)
    assert set(found.without([barred]).effects) == set(coarse.MOVED) - {barred}


def test_points_between_ticks_are_those_of_the_motion(planted: Maker) -> None:
    session = planted({}, duration=10.0)
    record = load_record(session, TwinFile.nominal_servo())
    motion = 6e-4 * np.sin(2.0 * np.pi * 28.0 * record.time)
    shaken = replace(record, encoder=motion[:, None])
    time = record.time[50:-50] + 0.5 * record.period
    exact = 6e-4 * np.sin(2.0 * np.pi * 28.0 * time)
    straight = np.interp(time, record.time, motion)
    assert np.abs(straight - exact).max() > 2e-6
    assert np.abs(shaken.encoder_at(time)[:, 0] - exact).max() < 5e-9


def test_a_few_lost_ticks_are_filled_along_the_motion(planted: Maker) -> None:
    session = planted({}, duration=10.0)
    whole = load_record(session, TwinFile.nominal_servo())
    states = session.series[topics.JOINT_STATES]
    kept = np.random.default_rng(0).random(len(states)) > 0.02
    kept[[0, -1]] = True
    cut = Series(states.topic, states.stamps[kept], {k: v[kept] for k, v in states.values.items()})
    series = {**session.series, topics.JOINT_STATES: cut}
    record = load_record(replace(session, series=series), TwinFile.nominal_servo())
    # As far as the encoder's own steps go.
    assert np.abs(record.encoder - whole.encoder).max() < 1.6e-6


def test_a_latency_between_ticks_is_named_alone(planted: Maker) -> None:
    session = planted({'tracker_latency': {'latency': 4.5e-3}}, axes=('x', 'y'))
    found: Diagnosis = diagnose([session], [], TwinFile.nominal_servo())
    assert found.verdict == ['tracker_latency']
    assert found.parameters['tracker_latency']['latency'][0] == pytest.approx(4.5e-3, abs=5e-6)


def with_read_noise(session: Session, white: float, jitter: float, seed: int = 1) -> Session:
    """The session with noise [m] on its encoders, read at moments that jitter [s]."""
    states = session.series[topics.JOINT_STATES]
    generator = np.random.default_rng(seed)
    values = dict(states.values)
    for axis in session.axes:
        q = values[f'position.{axis}']
        late = jitter * generator.standard_normal(len(q))
        noisy = q + np.gradient(q, 1e-3) * late + white * generator.standard_normal(len(q))
        values[f'position.{axis}'] = 1e-6 * np.rint(noisy / 1e-6)
    changed = Series(states.topic, states.stamps, values)
    return replace(session, series={**session.series, topics.JOINT_STATES: changed})


@pytest.mark.parametrize(('white', 'jitter'), [(0.0, 0.0), (4e-6, 0.0), (0.0, 3e-4), (1e-6, 1e-4)])
def test_noise_and_jitter_are_measured(planted: Maker, white: float, jitter: float) -> None:
    session = with_read_noise(planted({}, duration=10.0), white, jitter)
    record = load_record(session, TwinFile.nominal_servo())
    assert record.noise is not None
    found = record.noise.axes[0]
    assert found.jitter == pytest.approx(jitter, rel=0.1)
    assert found.beyond_steps == (white > 0.0 or jitter > 0.0)
    if jitter == 0.0:
        assert found.position == pytest.approx(np.hypot(white, 1e-6 / np.sqrt(12.0)), rel=0.1)
    # The twin states 1 µm, and its sessions have it; a noisier encoder hides it.
    assert record.noise.tracker is not None
    if white + jitter == 0.0:
        assert record.noise.tracker == pytest.approx(1e-6, rel=0.25)
    assert record.noise.tracker < 3e-6


@pytest.mark.parametrize(('white', 'jitter'), [(5e-6, 0.0), (0.0, 3e-4)])
def test_noise_in_the_acceleration_is_no_lighter_mass(
    planted: Maker, monkeypatch: pytest.MonkeyPatch, white: float, jitter: float
) -> None:
    session = with_read_noise(planted({}, duration=10.0), white, jitter)
    twin = TwinFile.nominal_servo()
    record = load_record(session, twin)

    def ratio() -> float:
        fit = Regression(Servo([record], twin, 'x').problem()).linear({'inertia_mismatch.x': ()})
        return float(fit.coefficients['inertia_mismatch.x'][0])

    assert abs(ratio()) < 3e-3
    # Without the cut the mass would be far too light.
    monkeypatch.setattr('gap_diagnosis.residuals.force_rows.CUTS', (np.inf,))
    assert ratio() < -0.03


def test_rows_that_a_cut_makes_alike_are_thinned_and_tell_as_much(
    planted: Maker, monkeypatch: pytest.MonkeyPatch
) -> None:
    twin, name = TwinFile.nominal_servo(), 'inertia_mismatch.x'
    record = load_record(with_read_noise(planted({}, duration=10.0), 5e-6, 0.0), twin)

    def found() -> tuple[Servo, float, float]:
        rows = Servo([record], twin, 'x')
        regression = Regression(rows.problem())
        fit = regression.linear({name: ()})
        deviation = uncertainty(regression, fit)[name][1][0]
        return rows, float(fit.coefficients[name][0]), float(deviation)

    rows, value, deviation = found()
    monkeypatch.setattr('gap_diagnosis.residuals.force_rows.ENOUGH', 1000)
    thinned, other, its = found()
    count, left = (np.count_nonzero(of.keep[0]) for of in (rows, thinned))
    assert 1000 <= left < 0.3 * count
    assert abs(other - value) < 0.2 * deviation
    assert its == pytest.approx(deviation, rel=0.1)
    np.testing.assert_array_equal(thinned.unlimited().keep[0], rows.keep[0])


@pytest.mark.parametrize(('white', 'jitter'), [(5e-6, 0.0), (0.0, 3e-4)])
def test_a_right_twin_is_not_blamed_for_noise(planted: Maker, white: float, jitter: float) -> None:
    session = with_read_noise(planted({}, axes=('x', 'y'), duration=12.0), white, jitter)
    found = diagnose([session], [], TwinFile.nominal_servo())
    assert found.verdict == (['sample_jitter'] if jitter > 0.0 else [])
    if jitter > 0.0:
        std, deviation = found.parameters['sample_jitter']['std']
        assert std == pytest.approx(jitter, rel=0.05)
        assert abs(std - jitter) < 4.0 * deviation
    noise = as_dict(found)['noise']
    measured = found.records[0].noise
    assert measured is not None
    assert noise['encoder.x'] == {'std': measured.axes[0].position, 'unit': 'm'}
    assert noise['jitter.x']['std'] == pytest.approx(jitter, rel=0.1)
    assert found.noise_floor > 1.5e-6


@pytest.mark.parametrize(
    ('limit', 'white', 'jitter'), [(1.0, 1e-6, 0.0), (2.0, 2e-6, 0.0), (8.0, 2e-6, 4e-5)]
)
def test_a_controller_that_is_limited_has_no_other_gains(
    planted: Maker, limit: float, white: float, jitter: float
) -> None:
    session = planted({'force_saturation.x': {'limit': limit, 'known': 1.0}}, duration=12.0)
    found = diagnose([with_read_noise(session, white, jitter)], [], TwinFile.nominal_servo())
    assert found.verdict == ['force_saturation.x']


def test_quick_turns_of_a_noisy_encoder_do_not_narrow_a_play() -> None:
    t = np.arange(20_000) * 1e-3
    strokes = 0.02 * np.sin(2.0 * np.pi * 0.3 * t) + 2e-4 * np.sin(2.0 * np.pi * 6.0 * t)
    path = (strokes * np.minimum(1.0, t) * np.where(t < 8.0, 0.01, 1.0))[:, None]
    twin = nominal()
    machine = twin.with_effects({'backlash.x': {'width': 9e-6}})
    session = with_read_noise(run_of(machine, twin, path, np.full(len(t), 20.0), 0), 1e-6, 0.0)
    found = diagnose([session], [], twin)
    assert found.verdict == ['backlash.x']
    # A path that is smoothed until no noise is left turns too early: 1.2 % less.
    assert found.parameters['backlash.x']['width'][0] == pytest.approx(9e-6, rel=6e-3)


@pytest.mark.parametrize('speed', [2e-4, 0.02, 0.2])
def test_the_step_of_an_encoder_is_found_at_any_speed(speed: float) -> None:
    times = 1e-3 * np.arange(20_000)
    noise = 3e-8 * np.random.default_rng(4).standard_normal(len(times))
    position = speed * times + 0.01 * np.sin(2.0 * np.pi * times) + noise
    assert encoder_step(4e-7 * np.rint(position / 4e-7)) == pytest.approx(4e-7, rel=1e-6)
    assert encoder_step(position) == 0.0


@pytest.mark.parametrize(('step', 'jitter'), [(2e-5, 0.0), (1e-8, 4e-4)])
def test_steps_that_are_coarser_than_stated_are_no_jitter(step: float, jitter: float) -> None:
    # It creeps and rests: steps of 20 µm make more noise in motion than at rest.
    times = 1e-3 * np.arange(30_000)
    late = jitter * np.random.default_rng(3).standard_normal(len(times))
    path = 2.5e-3 * np.minimum(times + late, 20.0)
    noise = 2e-7 * np.random.default_rng(5).standard_normal(len(times))
    read = step * np.rint((path + noise) / step)
    found = axis_noise(read, 1e-3, 2e-6, np.ones(len(times), bool))
    assert found.jitter == pytest.approx(jitter, rel=0.1)


def read_late(reach: float, jitter: float) -> Sampling | None:
    """What strokes [m] show that are read at moments that jitter [s], by an encoder of 5 nm."""
    times = 1e-3 * np.arange(20_000)
    late = jitter * np.random.default_rng(3).standard_normal(len(times))
    read = reach * np.sin(2.0 * np.pi * 0.5 * (times + late))
    counted = 5e-9 * np.rint(read / 5e-9)
    return sampling_jitter(counted, np.zeros_like(times), 1e-3, 5e-9, np.ones(len(times), bool))


def test_a_jitter_shows_where_it_is_most_of_the_noise() -> None:
    shown = [read_late(reach, 3e-5) for reach in (0.03, 0.02)]
    found = jitter_finding([Noise((), sampling=tuple(shown))], 1e-3, (False, False))
    assert found is not None
    assert found[0] == pytest.approx(3e-5, rel=0.05)
    # The clock of a good loop scatters, too, and a fine encoder shows it.
    good = read_late(0.03, 3e-6)
    assert good is not None
    assert good.std == pytest.approx(3e-6, rel=0.05)
    assert jitter_finding([Noise((), sampling=(good,))], 1e-3, (False,)) is None
    # What makes less noise than the counts do is none, and says nothing against another axis.
    hidden = read_late(0.03, 1e-8)
    assert hidden is not None
    assert hidden.std == 0.0
    assert jitter_finding([Noise((), sampling=(hidden,))], 1e-3, (False,)) is None
    slow = read_late(2e-6, 3e-5)
    assert slow is None or slow.std == 0.0
    assert jitter_finding([Noise((), sampling=(shown[0], slow))], 1e-3, (False, False)) is not None
    # An axis that would show it and does not speaks against it.
    calm = read_late(0.03, 0.0)
    assert jitter_finding([Noise((), sampling=(shown[0], calm))], 1e-3, (False, False)) is None


def test_stamps_of_the_tracker_that_scatter_are_named(planted: Maker) -> None:
    values = {'std': 0.0, 'tracker_std': 5e-4}
    session = planted({'sample_jitter': values}, axes=('x', 'y'), duration=12.0)
    found = diagnose([session], [], TwinFile.nominal_servo())
    assert found.verdict == ['sample_jitter']
    estimate, deviation = found.parameters['sample_jitter']['tracker_std']
    assert estimate == pytest.approx(5e-4, rel=0.1)
    assert 0.0 < deviation < 5e-5


def test_an_axis_at_rest_says_nothing_against_stamps_that_scatter() -> None:
    twin = TwinFile.nominal_servo()
    path = reference(12.0, twin.control_period, 2)
    path[:, 0] = 2e-6 * np.sin(np.arange(len(path)))  # a step to and fro, as noise makes it
    machine = twin.with_effects({'sample_jitter': {'std': 0.0, 'tracker_std': 5e-4}})
    found = diagnose([run_of(machine, twin, path, np.full(len(path), 20.0), 0)], [], twin)
    assert found.records[0].moving == (False, True)
    assert found.verdict == ['sample_jitter']


def test_a_yaw_shows_in_the_slow_points_of_a_tracker_whose_stamps_scatter(planted: Maker) -> None:
    yaw = {'quadratic': 3e-4, 'arm': 0.05}
    truth = {'sample_jitter': {'std': 0.0, 'tracker_std': 5e-4}, 'angular_error.y': yaw}
    session = planted(truth, axes=('x', 'y'), duration=20.0)
    found = diagnose([session], [], TwinFile.nominal_servo())
    assert sorted(found.verdict) == sorted(truth)


def test_a_gap_far_above_its_floor_is_not_explained_by_a_name_either() -> None:
    # Floors of 1 µm; the third leaves little of a gap that was much larger.
    assert far_from_explained(9e-6, 7e-6, 1e-6, named=True)
    assert not far_from_explained(9e-6, 3e-6, 1e-6, named=True)
    assert not far_from_explained(90e-6, 7e-6, 1e-6, named=True)
    assert far_from_explained(3e-6, 3e-6, 1e-6, named=False)
    # Beside a friction that the twin states it is the error of that friction's model.
    assert not far_from_explained(3e-6, 3e-6, 1e-6, named=False, stated=20e-6)
    assert far_from_explained(5e-6, 5e-6, 1e-6, named=False, stated=20e-6)


def test_what_a_coarse_encoder_rounds_is_no_jitter_of_the_tracker() -> None:
    # At about a step a point the rounding alternates, and it grows with the speed up to there.
    twin = nominal()
    weak = replace(
        twin.servo('x'),
        mass=3.3,
        viscous=9.4,
        encoder_resolution=2e-7,
        position_gain=30.5,
        velocity_feedforward=0.0,
        velocity_gain=570.0,
        integral_gain=7400.0,
        velocity_filter=1950.0,
    )
    twin = replace(twin, axes={'x': weak}, tracker=TrackerSpec(500.0, 2e-7))
    path = 0.03 * reference(20.0, twin.control_period, 1, seed=4)
    machine = twin.with_effects({'encoder_quantisation.x': {'resolution': 6.4e-6}})
    recorded = run_of(machine, twin, path, np.full(len(path), 20.0), 1)
    assert diagnose([recorded], [], twin).verdict == ['encoder_quantisation.x']
