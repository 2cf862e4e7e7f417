"""Effects of the drive and of what stands around an axis, against independent solutions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stage_twin.effects import torque_sag
from stage_twin.measured_force import required_force

from .one_axis import MASS, PERIOD, TICKS, VISCOUS, assert_moves_as, one_axis, open_loop, swing


def test_the_current_loop_is_a_first_order_lag():
    def rates(state, force):
        p, v, acting = state
        return [v, (acting - VISCOUS * v) / MASS, (force - acting) / 3e-3]

    assert_moves_as({'current_loop_lag.x': {'time_constant': 3e-3}}, rates, 3, 1e-3)


def test_the_force_constant_sags_with_squared_force_and_with_heat():
    def rates(state, force):
        left = max(0.2, 1.0 - 1e-4 * force**2 - state[2])
        return [
            state[1],
            (force * left - VISCOUS * state[1]) / MASS,
            (4e-4 * force**2 + 0.1 - state[2]) / 1.5,
        ]

    values = {'sag_force': 0.0, 'sag_square': 1e-4, 'sag_heat': 4e-4}
    values |= {'sag_time': 0.1, 'heat_time': 1.5}
    assert_moves_as({'torque_sag.x': values}, rates, 3, 2e-3)


def test_the_force_to_command_undoes_a_sag():
    force = np.linspace(-40.0, 40.0, 401)
    given = {'sag_force': 3e-3, 'sag_square': 3e-5, 'sag_speed': 0.5}
    given |= {'sag_heat': 0.0, 'sag_time': 0.0, 'heat_time': 9.0}
    commanded = torque_sag.command(force, np.full(401, 0.2), 1e-3, **given)
    acting = [torque_sag.drive(f, 0.2, 1e-3, np.zeros(1), **given) for f in commanded]
    np.testing.assert_allclose(acting, force, atol=1e-6)


@pytest.mark.parametrize('pulled', ['x', 'y'])
def test_the_other_axis_pulls(pulled):
    """What the other axis does in a tick pulls a free one as the equation says."""
    plain = replace(one_axis(), axes={a: one_axis().axes['x'] for a in 'xy'})
    twin = plain.with_effects({f'axis_crosstalk.{pulled}': {'mass': 2.0, 'viscous': 30.0}})
    i = 'xy'.index(pulled)
    force = np.zeros((TICKS, 2))
    force[:, 1 - i] = swing()
    moved, alone = open_loop(twin, force), open_loop(plain, force)
    np.testing.assert_array_equal(moved[:, 1 - i], alone[:, 1 - i])
    # Momentum of the pulled axis: m v + c p = -(2 v_other + 30 p_other), from rest.
    p, q = moved[:, i], moved[:, 1 - i]
    axis = twin.axes[pulled]
    balance = axis.mass * np.gradient(p, PERIOD) + axis.viscous * p
    pull = -(2.0 * np.gradient(q, PERIOD) + 30.0 * q)
    assert np.abs(pull).max() > 0.1
    assert np.abs(balance - pull)[:-1].max() < 1e-4 * np.abs(pull).max()


def test_the_needed_force_undoes_the_drive():
    """A twin with a lag, a sag and a play needs the force that it was given."""
    effects = {
        'current_loop_lag.x': {'time_constant': 4e-3},
        'torque_sag.x': {'sag_force': 4e-3, 'sag_speed': 1.0, 'sag_heat': 1e-4, 'heat_time': 2.0},
        'drive_play.x': {'width': 1e-7, 'mass_ratio': 0.25},
    }
    given = swing(30.0, 20.0, 1000)
    position = open_loop(one_axis(effects), given)[:, None]
    needed = {
        name: required_force(one_axis(some), position)[50:-50, 0]
        for name, some in (('with', effects), ('without', {}))
    }
    errors = {name: np.abs(force - given[50:-50]).max() for name, force in needed.items()}
    assert errors['with'] < 0.02 * 30.0
    assert errors['without'] > 0.08 * 30.0


def test_the_base_swings_on_its_mounts():
    ratio, natural, damping = 0.2, 2.0 * np.pi * 9.0, 0.05

    def rates(state, force):
        p, v, base, base_speed = state
        mounts = 2.0 * damping * natural * base_speed + natural**2 * base
        a = ((force - VISCOUS * v) / MASS + mounts) / (1.0 - ratio)
        return [v, a, base_speed, -ratio * a - mounts]

    values = {'frequency': 9.0, 'damping': damping, 'mass_ratio': ratio}
    assert_moves_as({'base_resonance.x': values}, rates, 4, 2e-4)


def test_friction_follows_its_level_along_the_travel():
    levels = (4.0, 6.0, 20.0, 12.0, 5.0, 9.0, 8.0)
    knots = np.linspace(0.0, 0.05, 7)
    stiffness = np.mean(levels) / 5e-6

    def rates(state, force):
        p, v, z = state
        reach = np.interp(p, knots, levels) / stiffness
        friction = VISCOUS * v + stiffness * z
        return [v, (force - friction) / MASS, v - abs(v) * z / reach]

    values = {f'c{k}': level for k, level in enumerate(levels)}
    values |= {'start': 0.0, 'stop': 0.05, 'presliding': 5e-6}
    assert_moves_as({'position_dependent_friction.x': values}, rates, 3, 3e-3)


def test_a_drive_with_play_pushes_at_its_edges():
    width, own, mass = 100e-6, 0.25 * MASS, 0.75 * MASS
    natural = 2.0 * np.pi * 300.0

    def rates(state, force):
        p, v, drive, speed = state
        apart = drive - p
        contact = 0.0
        if abs(apart) > 0.5 * width:
            contact = own * natural**2 * (apart - np.copysign(0.5 * width, apart))
            contact += 0.4 * own * natural * (speed - v)
            contact = max(contact, 0.0) if apart > 0.0 else min(contact, 0.0)
        return [v, (contact - VISCOUS * v) / mass, speed, (force - contact) / own]

    values = {'width': width, 'mass_ratio': 0.25, 'contact_frequency': 300.0}
    assert_moves_as({'drive_play.x': values}, rates, 4, 0.1)
