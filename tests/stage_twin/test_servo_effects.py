"""Servo effects against independent solutions: closed forms, and solve_ivp at tight tolerance."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stage_twin.simulate import simulate

from .one_axis import MASS, PERIOD, TICKS, VISCOUS, assert_moves_as, one_axis, open_loop, swing


def lugre(levels, presliding):
    """LuGre rates with sliding force levels(v) [N] and one presliding displacement."""

    def rates(state, force):
        p, v, z = state
        reach = levels(v)
        stiffness = levels(0.0) / presliding
        dz = v - abs(v) * z * stiffness / reach
        return [v, (force - VISCOUS * v - stiffness * z) / MASS, dz]

    return rates


def test_coulomb_friction_is_dahl():
    effects = {'coulomb_friction.x': {'coulomb': 10.0, 'presliding': 5e-6}}
    assert_moves_as(effects, lugre(lambda v: 10.0, 5e-6), 3)


@pytest.mark.parametrize('creep', [1e-4, 5e-3])
def test_a_friction_that_gives_way_is_a_smooth_function_of_the_speed(creep):
    def rates(state, force):
        p, v = state
        return [v, (force - VISCOUS * v - 10.0 * math.tanh(v / creep)) / MASS]

    values = {'coulomb': 10.0, 'presliding': 5e-6, 'creep_velocity': creep}
    assert_moves_as({'coulomb_friction.x': values}, rates, 2, share=3e-4)


def test_an_axis_creeps_under_less_than_the_level_of_a_friction_that_gives_way():
    values = {'coulomb': 10.0, 'creep_velocity': 1e-3}
    position = open_loop(one_axis({'coulomb_friction.x': values}, viscous=0.0), np.full(400, 6.0))
    speed = np.diff(position)[-1] / PERIOD
    assert speed == pytest.approx(1e-3 * math.atanh(0.6), rel=1e-6)


def test_stribeck_friction_is_lugre():
    values = {'coulomb': 8.0, 'breakaway': 6.0, 'stribeck_velocity': 0.02, 'presliding': 5e-6}

    def level(v):
        return 8.0 + 6.0 * math.exp(-((v / 0.02) ** 2))

    assert_moves_as({'stribeck_friction.x': values}, lugre(level, 5e-6), 3)


def test_asymmetric_friction():
    values = {
        'coulomb_positive': 12.0,
        'coulomb_negative': 8.0,
        'viscous_positive': 15.0,
        'viscous_negative': 60.0,
        'presliding': 5e-6,
    }

    # Its bristles have one stiffness in both directions, that of the mean level.
    def rates(state, force):
        p, v, z = state
        stiffness = 10.0 / 5e-6
        reach = (12.0 if v >= 0.0 else 8.0) / stiffness
        one_sided = 15.0 if v >= 0.0 else 60.0
        friction = (VISCOUS + one_sided) * v + stiffness * z
        return [v, (force - friction) / MASS, v - abs(v) * z / reach]

    assert_moves_as({'asymmetric_friction.x': values}, rates, 3)


@pytest.mark.parametrize('presliding', [0.0, 1e-7, 1e-6, 20e-6])
def test_a_sliding_mass_stops_where_energy_says(presliding):
    # Work of the push = work of friction over the whole way; pre-sliding gives back its own.
    coulomb = 10.0
    twin = one_axis(
        {'coulomb_friction.x': {'coulomb': coulomb, 'presliding': presliding}}, viscous=0.0
    )
    push = np.zeros(1500)
    push[:100] = 40.0
    position = open_loop(twin, push)
    expected = 40.0 * position[100] / coulomb
    assert position[-1] == pytest.approx(expected, abs=1e-5 + 2.0 * presliding)
    # At rest, but for the bristles' own ringing.
    assert np.ptp(position[-100:]) < 1e-9 + 0.1 * presliding


@pytest.mark.parametrize('presliding', [0.0, 1e-6])
def test_friction_holds_below_its_level(presliding):
    twin = one_axis({'coulomb_friction.x': {'coulomb': 10.0, 'presliding': presliding}})
    position = open_loop(twin, swing(9.0))
    # Dahl: force = level * (1 - exp(-x / g)) on the first loading.
    assert np.abs(position).max() < 1e-8 + presliding * 3.0


@pytest.mark.parametrize('coulomb', [1.0, 500.0])
def test_friction_only_takes_energy(coulomb):
    # Without drive the kinetic energy never grows beyond what the bristles give back.
    twin = one_axis({'coulomb_friction.x': {'coulomb': coulomb, 'presliding': 1e-6}}, viscous=0.0)
    push = np.zeros(400)
    push[:20] = 560.0
    speed = np.abs(np.diff(open_loop(twin, push)))[21:]
    moving = speed > 1e-7
    assert np.all(np.diff(speed[moving]) < 1e-12)


RIPPLE = {'amplitude': 4.0, 'period': 0.008, 'phase': 0.6}
SECOND = {'wave_amplitude2': 3.0, 'wave_period2': 0.005, 'wave_phase2': -0.4}


def wave(p, amplitude, period, phase):
    return amplitude * math.sin(2.0 * math.pi * p / period + phase)


@pytest.mark.parametrize(
    ('effect', 'values', 'acting', 'share'),
    [
        # The kernel takes the velocity at the start of each substep.
        (
            'viscous_friction',
            {'viscous': 10.0, 'quadratic': 400.0},
            lambda p, v, force: force - (10.0 + 400.0 * abs(v)) * v,
            1e-3,
        ),
        ('force_ripple', RIPPLE, lambda p, v, force: force + wave(p, 4.0, 0.008, 0.6), 1e-4),
        (
            'force_ripple',
            {**RIPPLE, **SECOND},
            lambda p, v, force: force + wave(p, 4.0, 0.008, 0.6) + wave(p, 3.0, 0.005, -0.4),
            1e-4,
        ),
        (
            'force_ripple',
            {**RIPPLE, 'growth': -0.5, 'centre': 0.01, 'half_range': 0.02},
            lambda p, v, force: (
                force
                + (1.0 - 0.5 * np.clip((p - 0.01) / 0.02, -1.0, 1.0)) * wave(p, 4.0, 0.008, 0.6)
            ),
            1e-4,
        ),
        (
            'cable_force',
            {'stiffness': 900.0, 'centre': 0.03, 'hardening': 4e5},
            lambda p, v, force: force - 900.0 * (p - 0.03) - 4e5 * (p - 0.03) ** 3,
            1e-4,
        ),
        (
            'torque_sag',
            {'sag_force': 8e-3, 'sag_speed': 2.0},
            lambda p, v, force: force * max(0.2, 1.0 - 8e-3 * abs(force) - 2.0 * abs(v)),
            2e-3,
        ),
    ],
)
def test_a_force_acts_beside_the_nominal_friction(effect, values, acting, share):
    def rates(state, force):
        p, v = state
        return [v, (acting(p, v, force) - VISCOUS * v) / MASS]

    assert_moves_as({f'{effect}.x': values}, rates, share=share)


def test_ripple_period_is_the_lead_by_default():
    given = one_axis({'force_ripple.x': {'amplitude': 4.0, 'period': 0.010}})
    default = one_axis({'force_ripple.x': {'amplitude': 4.0}})
    np.testing.assert_array_equal(open_loop(given, swing()), open_loop(default, swing()))


def test_structural_resonance_is_two_masses():
    values = {'frequency': 45.0, 'damping': 0.05, 'mass_ratio': 0.4}
    natural = 2.0 * math.pi * 45.0
    carried, motor = 0.4 * MASS, 0.6 * MASS
    stiffness, damping = carried * natural**2, 2.0 * 0.05 * carried * natural

    def rates(state, force):
        p, v, load, load_speed = state
        spring = stiffness * (load - p) + damping * (load_speed - v)
        return [v, (force - VISCOUS * v + spring) / motor, load_speed, -spring / carried]

    assert_moves_as({'structural_resonance.x': values}, rates, 4, 1e-5)


def test_rigid_limit_of_the_resonance():
    stiff = one_axis(
        {'structural_resonance.x': {'frequency': 400.0, 'damping': 1.0, 'mass_ratio': 0.1}}
    )
    soft_force = swing(30.0, 3.0)
    nominal = open_loop(one_axis(), soft_force)
    assert np.abs(open_loop(stiff, soft_force) - nominal).max() < 2e-4 * np.abs(nominal).max()


@pytest.mark.parametrize(
    ('effects', 'equivalent'),
    [
        ({'inertia_mismatch.x': {'ratio': 0.25}}, {'mass': MASS * 1.25}),
        ({'viscous_friction.x': {'viscous': -15.0}}, {'viscous': VISCOUS - 15.0}),
        ({'actuation_delay.x': {'delay': 0.0034}}, {'delay': 0.0034}),
    ],
)
def test_effects_that_change_a_nominal_parameter(effects, equivalent):
    np.testing.assert_allclose(
        open_loop(one_axis(effects), swing()),
        open_loop(one_axis(**equivalent), swing()),
        atol=1e-12,
    )


def test_delay_effect_adds_to_the_nominal_delay():
    both = one_axis({'actuation_delay.x': {'delay': 0.0014}}, delay=0.002)
    np.testing.assert_allclose(
        open_loop(both, swing()), open_loop(one_axis(delay=0.0034), swing()), atol=1e-14
    )


@pytest.mark.parametrize(
    ('effects', 'acting'),
    [
        ({'force_offset.x': {'offset': -3.0}}, swing() - 3.0),
        ({'drive_gain.x': {'error': -0.2}}, 0.8 * swing()),
        ({'force_saturation.x': {'limit': 12.0}}, np.clip(swing(), -12.0, 12.0)),
    ],
)
def test_effects_that_change_the_acting_force(effects, acting):
    np.testing.assert_allclose(
        open_loop(one_axis(effects), swing()), open_loop(one_axis(), acting), atol=1e-12
    )


def test_closed_loop_with_friction_ripple_and_a_fraction_of_delay():
    """The forces of a closed-loop session drive solve_ivp along the same path."""
    delay = 0.0013
    effects = {
        'coulomb_friction.x': {'coulomb': 10.0, 'presliding': 5e-6},
        'force_ripple.x': {'amplitude': 3.0, 'period': 0.004},
        'actuation_delay.x': {'delay': delay},
        'drive_gain.x': {'error': 0.1},
    }
    t = np.arange(TICKS) * PERIOD
    reference = (0.01 * np.sin(20.0 * t))[:, None]
    result = simulate(one_axis(effects), reference, np.gradient(reference, PERIOD, axis=0))
    friction = lugre(lambda v: 10.0, 5e-6)

    def rates(time, state, held):
        ripple = 3.0 * math.sin(2.0 * math.pi * state[0] / 0.004)
        return friction(state, 1.1 * held + ripple)

    # Command k acts from k T + delay on: nothing before the first one arrives.
    edges = np.concatenate([[0.0], t + delay])
    commands = np.concatenate([[0.0], result.force[:, 0]])
    state, positions = np.zeros(3), {0: 0.0}
    for start, end, held in zip(edges[:-1], edges[1:], commands[:-1], strict=True):
        tick = math.floor(end / PERIOD + 1e-9)
        inside = [tick * PERIOD] if start < tick * PERIOD <= end else []
        solution = solve_ivp(
            rates,
            (start, end),
            state,
            method='LSODA',
            t_eval=[*inside, end],
            args=(held,),
            rtol=1e-9,
            atol=1e-14,
        )
        if inside:
            positions[tick] = solution.y[0, 0]
        state = solution.y[:, -1]
    compared = [k for k in sorted(positions) if k < TICKS]
    assert len(compared) > 0.98 * TICKS
    exact = np.array([positions[k] for k in compared])
    travel = np.ptp(result.encoder)
    assert travel > 0.005
    assert np.abs(result.encoder[compared, 0] - exact).max() < 2e-4 * travel
