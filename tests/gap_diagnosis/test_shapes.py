"""Kinematic effects in the shapes in which machines have them, and not at their defaults."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.experiment.machine import draw, poor_motion, record
from benchmarks.experiment.machine import nominal as plane
from benchmarks.experiment.machine import session as run_of
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.result import Diagnosis
from stage_core.arrays import Array
from stage_core.session import Session
from stage_twin.effects import position_force, waveform
from stage_twin.effects.shared import within_seen

from .conftest import nominal, reference

Maker = Callable[..., Session]
TWIN, ALONE = nominal(('x', 'y')), nominal()


def assert_told(found: Diagnosis, effect: str, truth: dict[str, float]) -> None:
    """Each parameter is within four deviations, and known to a tenth."""
    for name, value in truth.items():
        estimate, deviation = found.parameters[effect][name]
        assert abs(estimate - value) < 4.0 * deviation
        assert deviation < 0.1 * value


def test_a_pitch_error_of_another_period_with_a_second_harmonic(planted: Maker) -> None:
    truth = {
        'amplitude': 5e-6,
        'period': 7e-3,
        'phase': 0.4,
        'amplitude_2': 1.5e-6,
        'phase_2': 1.0,
    }
    found = diagnose([planted({'cyclic_pitch_error.x': truth})], [], ALONE)
    assert found.verdict == ['cyclic_pitch_error.x']
    assert_told(found, 'cyclic_pitch_error.x', truth)


def test_a_slow_ripple_with_a_fourth_harmonic_is_no_smooth_force(planted: Maker) -> None:
    """Two and a half turns on the travel."""
    truth = {'amplitude': 4.0, 'period': 24e-3, 'phase': 0.4, 'amplitude_4': 1.3, 'phase_4': 1.0}
    found = diagnose([planted({'force_ripple.x': truth})], [], ALONE)
    assert found.verdict == ['force_ripple.x']
    known = {n: value for n, (value, _) in found.parameters['force_ripple.x'].items()}
    assert {n: known[n] for n in truth} == pytest.approx(truth, rel=0.01)


@pytest.mark.parametrize(
    ('name', 'amplitude'), [('cyclic_pitch_error.x', 6e-6), ('force_ripple.x', 4.0)]
)
def test_a_wave_that_grows_along_the_travel(planted: Maker, name: str, amplitude: float) -> None:
    truth = {'amplitude': amplitude, 'period': 4e-3, 'growth': -0.6, 'half_range': 0.03}
    found = diagnose([planted({name: truth})], [], ALONE)
    assert found.verdict == [name]
    known = {n: value for n, (value, _) in found.parameters[name].items()}
    assert known['period'] == pytest.approx(4e-3, rel=1e-3)
    place = [known[n] for n in ('growth', 'centre', 'half_range')]
    # What was travelled has another middle than what the plant was told.
    for p in (-0.02, 0.0, 0.015):
        assert known['amplitude'] * waveform.grown(p, *place) == pytest.approx(
            amplitude * (1.0 - 0.6 * p / 0.03), abs=0.05 * amplitude
        )


def test_a_pitch_error_of_two_near_periods(planted: Maker) -> None:
    truth = {'amplitude': 8e-6, 'period': 5e-3, 'wave_amplitude1': 4e-6, 'wave_period1': 6e-3}
    found = diagnose([planted({'cyclic_pitch_error.x': truth})], [], ALONE)
    assert found.verdict == ['cyclic_pitch_error.x']
    assert_told(found, 'cyclic_pitch_error.x', truth)


def test_a_force_that_changes_on_a_part_of_the_travel(planted: Maker) -> None:
    knots = [-3.0, -4.0, -1.5, -2.0, 0.5, 1.0, 3.5, 2.0, 3.0]
    truth = {'start': -0.006, 'stop': 0.0} | {f'c{k}': c for k, c in enumerate(knots)}
    found = diagnose([planted({'position_force.x': truth})], [], ALONE)
    assert found.verdict == ['position_force.x']
    for name in ('start', 'stop'):
        # A knot of the curve is 0.75 mm from the next, and 5 mm where it spans the travel.
        assert found.parameters['position_force.x'][name][0] == pytest.approx(
            truth[name], abs=7e-4
        )


def test_a_force_that_coarse_knots_do_not_follow(planted: Maker) -> None:
    knots = [-26.0, -5.0, -32.0, 31.0, 44.0, 15.0, -31.0, -15.0, 12.0]
    quarters = 2.0 * np.random.default_rng(0).standard_normal(16)
    truth = {'start': -0.03, 'stop': 0.03} | {f'c{k}': c for k, c in enumerate(knots)}
    truth |= {f'q{k}': float(q) for k, q in enumerate(quarters)}
    found = diagnose([planted({'position_force.x': truth}, duration=30.0)], [], ALONE)
    assert found.verdict == ['position_force.x']
    told = {n: v for n, (v, _) in found.parameters['position_force.x'].items()}
    places = np.linspace(told['start'], told['stop'], 200)
    assert np.std(_pull(told, places) - _pull(truth, places)) < 0.5


def _pull(known: dict[str, float], places: Array) -> Array:
    """Force (n,) [N] of the effect's parameters at some places [m]."""
    knots = [
        np.array([known.get(f'{letter}{k}', 0.0) for k in range(number)])
        for letter, number in (('c', 9), ('m', 8), ('q', 16))
    ]
    return np.array(
        [position_force.force(p, known['start'], known['stop'], *knots) for p in places]
    )


def test_a_friction_shows_where_an_axis_that_never_turns_back_stops() -> None:
    case = draw(4)
    assert case.motion == 'one_way' and case.effect == 'stribeck_friction.y'
    found = diagnose([record(case, poor_motion(case), 4, 'first')], [], plane())
    assert found.verdict == [case.effect]


def test_a_friction_that_falls_by_another_exponent_is_no_negative_viscosity(
    planted: Maker,
) -> None:
    name = 'stribeck_friction.x'
    truth = {'coulomb': 2.0, 'breakaway': 3.0, 'stribeck_velocity': 20e-3, 'exponent': 0.75}
    found = diagnose([planted({name: {**truth, 'presliding': 1e-6}}, duration=20.0)], [], ALONE)
    assert found.verdict == [name]
    value, deviation = found.parameters[name]['exponent']
    assert abs(value - truth['exponent']) < 3.0 * deviation
    assert deviation < 0.1


def test_a_friction_that_still_falls_at_the_highest_speed() -> None:
    """A Stribeck velocity of 12 mm/s where no speed above 5 mm/s was seen."""
    truth = {'coulomb': 4.0, 'breakaway': 3.0, 'stribeck_velocity': 12e-3, 'presliding': 2e-6}
    path, name = 0.04 * reference(12.0, ALONE.control_period, 1), 'stribeck_friction.x'
    warm = np.full(len(path), 20.0)
    found = diagnose([run_of(ALONE.with_effects({name: truth}), ALONE, path, warm, 0)], [], ALONE)
    assert found.verdict == [name]
    value, deviation = found.parameters[name]['breakaway']
    assert abs(value - 3.0) < 2.0 * deviation


def test_an_encoder_that_errs_within_each_period_of_its_scale(planted: Maker) -> None:
    truth = {'amplitude': 2e-6, 'period': 4e-5, 'phase': 0.4, 'amplitude_2': 1e-6, 'phase_2': 1.0}
    found = diagnose([planted({'encoder_interpolation.x': truth})], [], ALONE)
    assert found.verdict == ['encoder_interpolation.x']
    for name, value in truth.items():
        estimate, deviation = found.parameters['encoder_interpolation.x'][name]
        assert abs(estimate - value) < 4.0 * deviation + 0.05 * value
        assert deviation < 0.15 * value


@pytest.mark.parametrize('effect', ['cyclic_pitch_error.x', 'encoder_interpolation.x'])
def test_a_wave_of_two_millimetres_is_the_tables_or_the_encoders(
    planted: Maker, effect: str
) -> None:
    truth = {'amplitude': 5e-6, 'period': 2e-3, 'phase': 0.4}
    found = diagnose([planted({effect: truth})], [], ALONE)
    assert found.verdict == [effect]
    assert found.parameters[effect]['amplitude'][0] == pytest.approx(5e-6, rel=0.02)


def test_a_wave_of_the_table_is_where_it_was_when_the_point_was_taken(planted: Maker) -> None:
    wave = {'amplitude': 15e-6, 'period': 0.01, 'phase': 0.4}
    truth = {'cyclic_pitch_error.x': wave, 'tracker_latency': {'latency': 6e-3}}
    found = diagnose([planted(truth)], [], ALONE)
    assert sorted(found.verdict) == sorted(truth)
    told = found.parameters['cyclic_pitch_error.x']
    assert told['amplitude'][0] == pytest.approx(15e-6, rel=0.01)
    assert told['phase'][0] == pytest.approx(0.4, abs=0.02)


@pytest.mark.parametrize(('stroke', 'named'), [(0.02, []), (0.4, ['thermal_expansion.x'])])
def test_heat_far_from_where_the_screw_is_held(stroke: float, named: list[str]) -> None:
    """On short strokes it is a drift that is the same along the travel, as others are."""
    path = stroke * reference(12.0, 1e-3, 1)
    warmth = 20.0 + 4.0 * (1.0 - np.exp(-np.arange(len(path)) * 1e-3 / 8.0))
    machine = ALONE.with_effects(
        {'thermal_expansion.x': {'coefficient': 3e-5, 'fixed_point': 1.0}}
    )
    found = diagnose([run_of(machine, ALONE, path, warmth, 0)], [], ALONE)
    assert found.verdict == (named or ['unknown'])
    if named:
        told = found.parameters['thermal_expansion.x']
        assert told['coefficient'][0] * told['fixed_point'][0] == pytest.approx(3e-5, rel=0.01)


def test_a_yaw_that_is_not_zero_in_the_middle(planted: Maker) -> None:
    yaw = {'constant': 2e-5, 'linear': 4e-5, 'quadratic': -3e-5, 'arm': 0.2}
    place = {'centre': -0.0032, 'half_range': 0.0267}
    session = planted({'angular_error.y': {**yaw, **place}}, axes=('x', 'y'), duration=20.0)
    found = diagnose([session], [], TWIN)
    assert found.verdict == ['angular_error.y']
    assert found.after < 1.1 * found.noise_floor


def test_a_scale_error_beside_a_yaw_of_high_order(planted: Maker) -> None:
    # A yaw of all orders alone leaves 4 % of the noise's mean square of this.
    yaw = {'linear': -8e-5, 'quadratic': 4e-5, 'p3': 1e-4, 'p5': -4e-5, 'arm': -0.08}
    place = {'centre': -0.0032, 'half_range': 0.0267}
    truth = {'scale_error.x': {'error': -2.5e-4}, 'angular_error.x': {**yaw, **place}}
    found = diagnose([planted(truth, axes=('x', 'y'), duration=20.0)], [], TWIN)
    assert sorted(found.verdict) == sorted(truth)
    estimate, deviation = found.parameters['scale_error.x']['error']
    assert abs(estimate + 2.5e-4) < 4.0 * deviation


def test_a_guide_bent_like_no_polynomial_of_third_order(planted: Maker) -> None:
    # Over the travel of the session: the reference line is the one over it.
    place = {'centre': -0.0032, 'half_range': 0.0267}
    bend = {'quadratic': 4e-6, 'cubic': 1e-6, 'p4': -3e-6, 'p5': 2e-6}
    session = planted({'straightness.x': {**bend, **place}}, axes=('x', 'y'), duration=20.0)
    found = diagnose([session], [], TWIN)
    assert found.verdict == ['straightness.x']
    assert found.after < 1.1 * found.noise_floor
    for name, value in bend.items():
        estimate, deviation = found.parameters['straightness.x'][name]
        assert abs(estimate - value) < 4.0 * deviation
        assert deviation < 0.1 * abs(value)


def test_a_guide_that_is_bent_in_high_orders_alone(planted: Maker) -> None:
    bend = {'quadratic': 0.0, 'p7': 8e-6, **{'centre': -0.0032, 'half_range': 0.0267}}
    session = planted({'straightness.x': bend}, axes=('x', 'y'), duration=20.0)
    found = diagnose([session], [], TWIN)
    assert found.verdict == ['straightness.x']
    assert found.after < 1.2 * found.noise_floor


def test_a_curve_is_not_larger_where_nothing_was_measured() -> None:
    bow = np.array([0.0, 0.0, 1.0])
    assert within_seen(bow, np.linspace(-1.0, 1.0, 300))
    assert not within_seen(bow, np.array([-1.0, -0.95, -0.9, 0.9, 0.95, 1.0]))


def test_a_wave_of_which_a_tenth_is_travelled_is_none() -> None:
    twin = nominal()
    path = 0.02 * reference(12.0, twin.control_period, 1)
    assert np.ptp(path) < 0.2 * twin.axes['x'].lead
    real = twin.with_effects({'cyclic_pitch_error.x': {'amplitude': 5e-5}})
    found = diagnose([run_of(real, twin, path, np.full(len(path), 20.0), 0)], [], twin)
    assert 'cyclic_pitch_error.x' not in found.verdict


def test_the_load_that_the_tracker_sees_swing(planted: Maker) -> None:
    swing = {'frequency': 12.0, 'damping': 0.03, 'mass_ratio': 0.3, 'table_share': 1.0}
    found = diagnose([planted({'structural_resonance.x': swing})], [], ALONE)
    assert found.verdict == ['structural_resonance.x']
    assert found.after < 1.2 * found.noise_floor
    for name, value in swing.items():
        estimate, _ = found.parameters['structural_resonance.x'][name]
        assert estimate == pytest.approx(value, rel=0.1)


def test_a_viscous_friction_that_grows_with_the_speed(planted: Maker) -> None:
    truth = {'viscous': 20.0, 'quadratic': 300.0}
    found = diagnose([planted({'viscous_friction.x': truth})], [], ALONE)
    assert found.verdict == ['viscous_friction.x']
    assert_told(found, 'viscous_friction.x', truth)


def test_a_rotor_of_seven_times_the_mass(planted: Maker) -> None:
    found = diagnose([planted({'inertia_mismatch.x': {'ratio': 7.0}})], [], ALONE)
    assert found.verdict == ['inertia_mismatch.x']
    assert_told(found, 'inertia_mismatch.x', {'ratio': 7.0})


def test_a_guide_whose_line_is_that_over_a_wider_travel(planted: Maker) -> None:
    # The session covers 0.8 of the travel, not in its middle: slope and offset are the guide's.
    bend = {'quadratic': 14e-6, 'cubic': 9e-6, 'centre': 0.002, 'half_range': 0.034}
    session = planted({'straightness.x': bend}, axes=('x', 'y'), duration=20.0)
    found = diagnose([session], [], TWIN)
    assert found.verdict == ['straightness.x']
    assert found.after < 1.1 * found.noise_floor


def test_an_encoder_that_errs_by_much_of_its_period(planted: Maker) -> None:
    # The drive answers what it reads: the force balance is that of the motion behind it.
    truth = {'amplitude': 2e-5, 'period': 5e-4, 'phase': 0.4}
    found = diagnose([planted({'encoder_interpolation.x': truth})], [], ALONE)
    assert found.verdict == ['encoder_interpolation.x']
    estimate, _ = found.parameters['encoder_interpolation.x']['amplitude']
    assert estimate == pytest.approx(truth['amplitude'], rel=0.02)


def test_a_friction_that_is_the_same_in_both_directions(planted: Maker) -> None:
    # Levels and slopes of both directions explain more than any other single effect does.
    stribeck = {'coulomb': 1.1, 'breakaway': 0.9, 'stribeck_velocity': 0.013}
    effects = {'stribeck_friction.x': stribeck, 'viscous_friction.x': {'viscous': -18.0}}
    found = diagnose([planted(effects)], [], ALONE)
    assert sorted(found.verdict) == ['stribeck_friction.x', 'viscous_friction.x']
