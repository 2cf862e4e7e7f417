"""Compiled loops for a rig whose recorded force is the plant's input."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stage_twin import layout as at
from stage_twin.friction import bristle_stiffness, slide_bristle
from stage_twin.kernel import advance, load_force


@njit(cache=True)
def follow_hidden_states(
    axes: np.ndarray,
    period: float,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    bristle: np.ndarray,
    deflection: np.ndarray,
    deflection_rate: np.ndarray,
) -> None:
    """States that no sensor sees, driven by the recorded motion (n, n_axes).

    The bristles of the friction follow the velocity; the mass behind the spring follows the
    motor's acceleration, d'' + 2 zeta w d' + w^2 d = -a, by its exact step under held a.
    """
    count = velocity.shape[0]
    for axis in range(axes.shape[0]):
        row = axes[axis]
        stiffness = bristle_stiffness(row)
        if stiffness > 0.0:
            for k in range(1, count):
                mean = 0.5 * (velocity[k - 1, axis] + velocity[k, axis])
                bristle[k, axis] = slide_bristle(
                    row, stiffness, bristle[k - 1, axis], mean, period
                )
        if row[at.RESONANCE_FREQUENCY] > 0.0 and row[at.RESONANCE_RATIO] > 0.0:
            natural = 2.0 * math.pi * row[at.RESONANCE_FREQUENCY]
            zeta = min(row[at.RESONANCE_DAMPING], 0.999999)
            decay = zeta * natural
            ringing = natural * math.sqrt(1.0 - zeta * zeta)
            shrink = math.exp(-decay * period)
            cosine = math.cos(ringing * period)
            sine = math.sin(ringing * period)
            for k in range(1, count):
                mean = 0.5 * (acceleration[k - 1, axis] + acceleration[k, axis])
                settled = -mean / natural**2
                offset = deflection[k - 1, axis] - settled
                rate = deflection_rate[k - 1, axis]
                slope = (rate + decay * offset) / ringing
                deflection[k, axis] = settled + shrink * (offset * cosine + slope * sine)
                deflection_rate[k, axis] = shrink * (
                    rate * cosine - (natural**2 * offset + decay * rate) / ringing * sine
                )


@njit(cache=True)
def needed_force(
    axes: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    bristle: np.ndarray,
    deflection: np.ndarray,
    deflection_rate: np.ndarray,
    external: np.ndarray,
    out: np.ndarray,
) -> None:
    """Force of the drive that the recorded motion needs, (n, n_axes) [N], written to `out`."""
    for axis in range(axes.shape[0]):
        row = axes[axis]
        mass = row[at.MASS] * (1.0 + row[at.INERTIA_RATIO])
        stiffness = bristle_stiffness(row)
        carried = 0.0
        spring = 0.0
        damper = 0.0
        if row[at.RESONANCE_FREQUENCY] > 0.0:
            natural = 2.0 * math.pi * row[at.RESONANCE_FREQUENCY]
            carried = mass * row[at.RESONANCE_RATIO]
            spring = carried * natural**2
            damper = 2.0 * row[at.RESONANCE_DAMPING] * carried * natural
        for k in range(position.shape[0]):
            speed = velocity[k, axis]
            one_sided = row[at.VISCOUS_POSITIVE] if speed >= 0.0 else row[at.VISCOUS_NEGATIVE]
            force = (mass - carried) * acceleration[k, axis]
            force += (row[at.VISCOUS] + row[at.VISCOUS_ADDED] + one_sided) * speed
            force -= spring * deflection[k, axis] + damper * deflection_rate[k, axis]
            force += stiffness * bristle[k, axis]
            force -= load_force(row, position[k, axis]) + external[k, axis]
            out[k, axis] = force


@njit(cache=True)
def run_windows(
    axes: np.ndarray,
    transitions: np.ndarray,
    schedule: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    bristle: np.ndarray,
    deflection: np.ndarray,
    deflection_rate: np.ndarray,
    force: np.ndarray,
    external: np.ndarray,
    window: int,
    simulated: np.ndarray,
    simulated_velocity: np.ndarray,
) -> None:
    """Open-loop runs of `window` ticks, each from the recorded state at its first tick.

    Parameters
    ----------
    force : (n_axes, n)
        Commanded force [N].
    simulated, simulated_velocity : (n, n_axes), written
    """
    state = np.zeros((axes.shape[0], at.STATE_WIDTH))
    for k in range(position.shape[0]):
        for axis in range(axes.shape[0]):
            if k % window == 0:
                state[axis, at.POSITION] = position[k, axis]
                state[axis, at.VELOCITY] = velocity[k, axis]
                state[axis, at.BRISTLE] = bristle[k, axis]
                state[axis, at.DEFLECTION] = deflection[k, axis]
                state[axis, at.DEFLECTION_RATE] = deflection_rate[k, axis]
            simulated[k, axis] = state[axis, at.POSITION]
            simulated_velocity[k, axis] = state[axis, at.VELOCITY]
        advance(axes, transitions, schedule, state, force, k, external[k])
