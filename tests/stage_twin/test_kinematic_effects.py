"""Kinematic effects against the conventions of interfaces.md, written out in NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from stage_core.twin_file import TwinFile
from stage_twin.simulate import SimulationResult, simulate

COUNT = 1500
TIMES = np.arange(COUNT) * 1e-3
LEAD = 0.010


def twin_with(effects):
    twin = TwinFile.nominal_servo()
    # A fine encoder shows the motor's position.
    axes = {name: replace(axis, encoder_resolution=1e-13) for name, axis in twin.axes.items()}
    return replace(twin, axes=axes).with_effects(effects)


def run(effects, **options) -> SimulationResult:
    x = 0.02 * (1.0 - np.cos(5.0 * TIMES))
    y = 0.015 * np.sin(4.0 * TIMES) ** 2
    reference = np.stack([x, y], axis=1)
    rate = np.gradient(reference, 1e-3, axis=0)
    return simulate(twin_with(effects), reference, rate, noise=False, **options)


def legendre(order, position, centre, half):
    return np.polynomial.legendre.Legendre.basis(order)((position - centre) / half)


def test_nominal_table_is_the_motor():
    result = run({})
    np.testing.assert_allclose(result.table, result.encoder, atol=1e-12)


def test_scale_error():
    result = run({'scale_error.y': {'error': 3e-4}})
    np.testing.assert_allclose(result.table[:, 1], result.encoder[:, 1] * 1.0003, atol=1e-12)
    np.testing.assert_allclose(result.table[:, 0], result.encoder[:, 0], atol=1e-12)


@pytest.mark.parametrize('period', [0.0, 0.004])
def test_cyclic_pitch_error(period):
    result = run({'cyclic_pitch_error.x': {'amplitude': 5e-6, 'period': period, 'phase': 0.3}})
    motor = result.encoder[:, 0]
    expected = motor + 5e-6 * np.sin(2.0 * np.pi * motor / (period or LEAD) + 0.3)
    np.testing.assert_allclose(result.table[:, 0], expected, atol=1e-11)


def test_a_cyclic_pitch_error_grows_and_has_waves_of_other_periods():
    values = {'amplitude': 5e-6, 'growth': 0.4, 'centre': 0.005, 'half_range': 0.01}
    values |= {'wave_amplitude1': 2e-6, 'wave_period1': 3e-3, 'wave_phase1': 0.7}
    result = run({'cyclic_pitch_error.x': values})
    motor = result.encoder[:, 0]
    factor = 1.0 + 0.4 * np.clip((motor - 0.005) / 0.01, -1.0, 1.0)
    expected = motor + factor * 5e-6 * np.sin(2.0 * np.pi * motor / LEAD)
    expected += 2e-6 * np.sin(2.0 * np.pi * motor / 3e-3 + 0.7)
    np.testing.assert_allclose(result.table[:, 0], expected, atol=1e-11)


def test_nonorthogonality():
    angle = 1e-3
    result = run({'nonorthogonality': {'angle': angle}})
    x, y = result.encoder.T
    np.testing.assert_allclose(result.table[:, 0], x - np.sin(angle) * y, atol=1e-12)
    np.testing.assert_allclose(result.table[:, 1], np.cos(angle) * y, atol=1e-12)


@pytest.mark.parametrize(('axis', 'own', 'other'), [('x', 0, 1), ('y', 1, 0)])
def test_straightness_displaces_the_other_axis(axis, own, other):
    values = {'quadratic': 6e-6, 'cubic': -3e-6, 'centre': 0.01, 'half_range': 0.03}
    result = run({f'straightness.{axis}': values})
    motor = result.encoder
    bend = 6e-6 * legendre(2, motor[:, own], 0.01, 0.03) - 3e-6 * legendre(
        3, motor[:, own], 0.01, 0.03
    )
    np.testing.assert_allclose(result.table[:, other], motor[:, other] + bend, atol=1e-11)
    np.testing.assert_allclose(result.table[:, own], motor[:, own], atol=1e-12)


def test_straightness_has_twenty_orders():
    values = {f'p{k}': 1e-6 / k for k in range(4, 21)}
    result = run({'straightness.x': {**values, 'quadratic': 0.0, 'half_range': 0.05}})
    x, y = result.encoder.T
    bend = sum(1e-6 / k * legendre(k, x, 0.0, 0.05) for k in range(4, 21))
    assert np.ptp(bend) > 2e-7
    np.testing.assert_allclose(result.table[:, 1], y + bend, atol=1e-11)


def test_straightness_has_no_reference_line():
    # Least-squares line through the displacement over the whole travel: nothing is left.
    s = np.linspace(-1.0, 1.0, 20001)
    displacement = 6e-6 * legendre(2, s, 0.0, 1.0) - 3e-6 * legendre(3, s, 0.0, 1.0)
    slope, offset = np.polyfit(s, displacement, 1)
    assert abs(slope) < 1e-9
    assert abs(offset) < 1e-9


def test_angular_error_is_a_rotation_about_the_guide():
    values = {'linear': 2e-4, 'quadratic': -1e-4, 'arm': 0.07, 'centre': 0.01, 'half_range': 0.04}
    result = run({'angular_error.x': values})
    x, y = result.encoder.T
    yaw = 2e-4 * legendre(1, x, 0.01, 0.04) - 1e-4 * legendre(2, x, 0.01, 0.04)
    # The point hangs (y + arm) beside the guide: an exact rotation, to first order in the yaw.
    rotated = x - np.sin(yaw) * (y + 0.07)
    np.testing.assert_allclose(result.table[:, 0], rotated, atol=1e-11)
    np.testing.assert_allclose(result.table[:, 1], y, atol=1e-12)


def test_angular_error_of_y():
    result = run({'angular_error.y': {'linear': 2e-4, 'arm': 0.07, 'half_range': 0.05}})
    x, y = result.encoder.T
    np.testing.assert_allclose(result.table[:, 1], y + 2e-4 * y / 0.05 * (x + 0.07), atol=1e-11)


def test_backlash_is_a_play_that_starts_centred():
    width = 12e-6
    result = run({'backlash.x': {'width': width}})
    motor = result.encoder[:, 0]
    played = [motor[0]]
    for position in motor[1:]:
        played.append(min(max(played[-1], position - width / 2), position + width / 2))
    # Ticks do not fall on the turning points exactly.
    np.testing.assert_allclose(result.table[:, 0], played, atol=2e-9)
    lag = motor - result.table[:, 0]
    assert lag.max() == pytest.approx(width / 2, abs=1e-12)
    assert lag.min() == pytest.approx(-width / 2, abs=1e-12)
    assert lag[0] == 0.0


def test_thermal_expansion_with_recorded_temperatures():
    values = {'coefficient': 12e-6, 'fixed_point': -0.2}
    temperatures = np.stack([20.0 + 3.0 * TIMES, np.full(COUNT, 21.0)], axis=1)
    result = run({'thermal_expansion.x': values}, temperatures=temperatures)
    motor = result.encoder[:, 0]
    expected = motor + 12e-6 * (temperatures[:, 0] - 20.0) * (motor + 0.2)
    np.testing.assert_allclose(result.table[:, 0], expected, atol=1e-12)
    np.testing.assert_allclose(result.temperatures, temperatures)


def test_simulated_screw_is_a_first_order_thermal_mass():
    values = {'initial_rise': 4.0, 'heating': 0.0, 'time_constant': 2.0}
    cooling = run({'thermal_expansion.x': values}).temperatures
    np.testing.assert_allclose(cooling[:, 0], 20.0 + 4.0 * np.exp(-TIMES / 2.0), rtol=1e-9)
    np.testing.assert_allclose(cooling[:, 1], 20.0)
    values = {'initial_rise': 0.0, 'heating': 100.0, 'time_constant': 2.0}
    warm = run({'thermal_expansion.x': values})
    # Exact for the mean of |v| over each tick, from the motor's own path.
    rise = [0.0]
    for speed in np.abs(np.diff(warm.encoder[:, 0])) / 1e-3:
        rise.append(100.0 * speed + (rise[-1] - 100.0 * speed) * np.exp(-1e-3 / 2.0))
    np.testing.assert_allclose(warm.temperatures[:, 0] - 20.0, rise, rtol=0.02, atol=0.01)


def test_effects_leave_the_servo_link_alone():
    effects = {
        'backlash.x': {},
        'cyclic_pitch_error.y': {},
        'nonorthogonality': {},
        'straightness.x': {},
        'thermal_expansion.y': {},
        'angular_error.x': {},
        'scale_error.x': {},
    }
    np.testing.assert_array_equal(run(effects).encoder, run({}).encoder)
