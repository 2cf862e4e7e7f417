"""One axis of a servo twin, driven open loop, and the same by solve_ivp."""

from dataclasses import replace

import numpy as np
from scipy.integrate import solve_ivp

from stage_core.twin_file import ServoAxis, TwinFile
from stage_twin.plant import ServoPlant

PERIOD = 1e-3
MASS, VISCOUS = 18.0, 40.0
TICKS = 300


def one_axis(effects=None, **changes):
    axis = replace(ServoAxis(MASS, VISCOUS), encoder_resolution=1e-13, **changes)
    return TwinFile('servo', {'x': axis}, PERIOD, effects=effects or {})


def open_loop(twin, force):
    """Motor positions [m] of the shape of the force commands (n,) or (n, n_axes) [N]."""
    plant, positions = ServoPlant(twin), np.zeros(force.shape)
    for k, held in enumerate(force):
        positions[k] = plant.encoder() if force.ndim == 2 else plant.encoder()[0]
        plant.step(np.atleast_1d(held))
    return positions


def swing(amplitude=30.0, rate=20.0, count=TICKS):
    return amplitude * np.sin(rate * np.arange(count) * PERIOD)


def integrate(derivative, force, size=2):
    """Position (n,) by solve_ivp tick by tick; derivative(state, force) -> rates."""
    state = np.zeros(size)
    positions = []
    for held in force:
        positions.append(state[0])
        solution = solve_ivp(
            lambda t, s, f=held: derivative(s, f),
            (0.0, PERIOD),
            state,
            method='LSODA',
            rtol=1e-9,
            atol=1e-14,
        )
        state = solution.y[:, -1]
    return np.array(positions)


def assert_moves_as(effects, derivative, size=2, share=1e-4):
    """Effects on x give the motion of `derivative`, but for a share of what they change."""
    exact = integrate(derivative, swing(), size)
    change = np.abs(exact - open_loop(one_axis(), swing())).max()
    assert change > 1e-6
    assert np.abs(open_loop(one_axis(effects), swing()) - exact).max() < share * change
