"""The kernel against a literal transcription of interfaces.md, "Servo controller"."""

import math
from dataclasses import replace

import numpy as np
import pytest

from stage_core.twin_file import TwinFile
from stage_twin.simulate import simulate


def literal(axis, period, reference, reference_velocity, compensation):
    """The servo controller line by line for one axis, in plain Python."""
    m, b = axis.mass, axis.viscous

    def move(p, v, force, length):
        # Closed solution of m p'' = F - b p' under constant force.
        decay = math.exp(-b * length / m)
        settled = force / b
        return (
            p + settled * length + (v - settled) * m / b * (1.0 - decay),
            settled + (v - settled) * decay,
        )

    a = math.exp(-period * axis.velocity_filter)
    p, v, integral, vf = float(reference[0]), 0.0, 0.0, 0.0
    q_last = round(p / axis.encoder_resolution) * axis.encoder_resolution
    ticks = math.floor(axis.delay / period + 1e-9)
    fraction = axis.delay - ticks * period
    forces, rows = [], []
    for k in range(len(reference)):
        q = round(p / axis.encoder_resolution) * axis.encoder_resolution
        vf = a * vf + (1.0 - a) * (q - q_last) / period
        vc = (
            axis.velocity_feedforward * reference_velocity[k]
            + axis.position_gain * (reference[k] - q)
            + compensation[k]
        )
        ev = vc - vf
        wanted = axis.velocity_gain * ev + integral
        force = max(-axis.force_limit, min(axis.force_limit, wanted))
        clipped = force != wanted
        if not (clipped and wanted * ev > 0.0):
            integral = integral + axis.integral_gain * ev * period
        q_last = q
        forces.append(force)
        rows.append((q, vf, vc, force, p))
        older = forces[k - ticks - 1] if k > ticks else 0.0
        newer = forces[k - ticks] if k >= ticks else 0.0
        p, v = move(p, v, older, fraction)
        p, v = move(p, v, newer, period - fraction)
    return np.array(rows)


def session(period, axes, seconds=0.6):
    t = np.arange(round(seconds / period)) * period
    x = 0.02 * (1.0 - np.cos(9.0 * t)) + 1e-3 * (t > 0.3)
    y = 0.015 * np.sin(7.0 * t) ** 3 + 0.0123
    reference = np.stack([x, y], axis=1)[:, :axes]
    return reference, np.gradient(reference, period, axis=0)


@pytest.mark.parametrize('period', [0.001, 0.0004])
@pytest.mark.parametrize('delay', [0.0, 0.0003, 0.002, 0.0027])
@pytest.mark.parametrize('limit', [600.0, 40.0])
def test_kernel_is_the_servo_controller(period, delay, limit):
    twin = TwinFile.nominal_servo()
    change = {'delay': delay, 'force_limit': limit, 'velocity_feedforward': 0.9}
    twin = replace(
        twin,
        control_period=period,
        axes={name: replace(axis, **change) for name, axis in twin.axes.items()},
    )
    reference, rate = session(period, 2)
    compensation = 1e-3 * np.sin(40.0 * reference)
    result = simulate(twin, reference, rate, compensation=compensation)
    for index, axis in enumerate(twin.axes.values()):
        expected = literal(
            axis, period, reference[:, index], rate[:, index], compensation[:, index]
        )
        np.testing.assert_allclose(result.encoder[:, index], expected[:, 0], atol=1e-14)
        np.testing.assert_allclose(result.velocity[:, index], expected[:, 1], atol=1e-11)
        np.testing.assert_allclose(result.velocity_command[:, index], expected[:, 2], atol=1e-11)
        np.testing.assert_allclose(result.force[:, index], expected[:, 3], atol=1e-7)
        np.testing.assert_allclose(result.table[:, index], expected[:, 4], atol=1e-12)
    if limit == 40.0:
        assert np.abs(result.force).max() == limit


def test_one_axis_gives_what_two_give_for_it():
    twin = TwinFile.nominal_servo()
    alone = replace(twin, axes={'x': twin.axes['x']})
    reference, rate = session(0.001, 2)
    both = simulate(twin, reference, rate, noise=False)
    one = simulate(alone, reference[:, :1], rate[:, :1], noise=False)
    np.testing.assert_array_equal(one.encoder[:, 0], both.encoder[:, 0])
    np.testing.assert_array_equal(one.tracker_points[:, 0], both.tracker_points[:, 0])
    assert not one.tracker_points[:, 1].any()


def test_stands_still_without_a_reference_motion():
    twin = TwinFile.nominal_servo()
    reference = np.full((200, 2), 0.0123450)
    result = simulate(twin, reference, np.zeros_like(reference))
    assert not result.force.any()
    np.testing.assert_array_equal(result.table, reference)
