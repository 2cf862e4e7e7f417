"""Compiled loops for a rig whose recorded force is the plant's input."""

from __future__ import annotations

import math

import numpy as np

from stage_twin import hooks
from stage_twin import layout as at
from stage_twin.compiled import compiled
from stage_twin.friction import slide_bristle, yielding
from stage_twin.kernel import advance, start_plant
from stage_twin.packing import KernelArrays, Work


@compiled
def follow_hidden_states(
    arrays: KernelArrays, motion: np.ndarray, force: np.ndarray, states: np.ndarray
) -> None:
    """States that no sensor sees, driven by the recorded motion.

    The bristles of the friction follow the velocity; the mass behind the spring follows the
    motor's acceleration, d'' + 2 zeta w d' + w^2 d = -a, by its exact step under held a; the
    effects' own states follow the motion and the force.

    Parameters
    ----------
    motion : (3, n, n_axes)
        Position, velocity, acceleration.
    force : (n, n_axes)
        Commanded force [N].
    states : (n, n_axes, STATE_WIDTH), written
    """
    axes, period = arrays.axes, arrays.period
    count = motion.shape[1]
    start_plant(axes, motion[0, 0], states[0])
    for axis in range(axes.shape[0]):
        row = axes[axis]
        stiffness, creep = arrays.schedule[axis, at.BRISTLES], arrays.schedule[axis, at.CREEP]
        for k in range(count):
            own = states[k, axis]
            if k > 0:
                _copy(states[k - 1, axis], own)
                _step_own(axes, axis, period, k - 1, motion[:, k - 1], force[k - 1, axis], own)
            own[at.POSITION] = motion[0, k, axis]
            own[at.VELOCITY] = motion[1, k, axis]
            if k > 0 and stiffness > 0.0 and creep == 0.0:
                mean = 0.5 * (motion[1, k - 1, axis] + motion[1, k, axis])
                own[at.BRISTLE] = slide_bristle(
                    row, own, stiffness, own[at.BRISTLE], motion[0, k, axis], mean, period
                )
            if k > 0 and row[at.NATURAL] > 0.0 and row[at.CARRIED] > 0.0:
                mean = 0.5 * (motion[2, k - 1, axis] + motion[2, k, axis])
                _step_mass(row, period, mean, own)


@compiled
def _copy(state: np.ndarray, out: np.ndarray) -> None:
    for index in range(at.STATE_WIDTH):
        out[index] = state[index]


@compiled
def _step_own(
    axes: np.ndarray,
    axis: int,
    period: float,
    tick: int,
    motion: np.ndarray,
    force: float,
    state: np.ndarray,
) -> float:
    """Force of the effects in a tick of the recorded motion (3, n_axes); their states move on."""
    row = axes[axis]
    position = motion[0, axis]
    velocity = motion[1, axis]
    acting = hooks.drive(row, state, force, position, velocity, period, tick * period)
    other = axes.shape[0] - 1 - axis
    coupled = 1.0 if axes.shape[0] == 2 else 0.0
    return hooks.force(
        row,
        state,
        position,
        velocity,
        acting,
        period,
        tick * period,
        coupled * motion[1, other],
        coupled * motion[2, other],
    )


@compiled
def _step_mass(row: np.ndarray, period: float, acceleration: float, state: np.ndarray) -> None:
    natural = row[at.NATURAL]
    zeta = min(row[at.DAMPING], 0.999999)
    decay = zeta * natural
    ringing = natural * math.sqrt(1.0 - zeta * zeta)
    shrink = math.exp(-decay * period)
    cosine = math.cos(ringing * period)
    sine = math.sin(ringing * period)
    settled = -acceleration / natural**2
    offset = state[at.DEFLECTION] - settled
    rate = state[at.DEFLECTION_RATE]
    slope = (rate + decay * offset) / ringing
    state[at.DEFLECTION] = settled + shrink * (offset * cosine + slope * sine)
    state[at.DEFLECTION_RATE] = shrink * (
        rate * cosine - (natural**2 * offset + decay * rate) / ringing * sine
    )


@compiled
def needed_force(
    arrays: KernelArrays, own: np.ndarray, motion: np.ndarray, states: np.ndarray, out: np.ndarray
) -> None:
    """Force of the drive that the recorded motion needs, (n, n_axes) [N], written to `out`.

    `motion` and `states` as in :func:`follow_hidden_states`; the states are left as they are
    and copied to `own` (STATE_WIDTH,).
    """
    axes, period = arrays.axes, arrays.period
    for axis in range(axes.shape[0]):
        row = axes[axis]
        stiffness, creep = arrays.schedule[axis, at.BRISTLES], arrays.schedule[axis, at.CREEP]
        carried = row[at.CARRIED]
        spring = carried * row[at.NATURAL] ** 2
        damper = 2.0 * row[at.DAMPING] * carried * row[at.NATURAL]
        for k in range(motion.shape[1]):
            _copy(states[k, axis], own)
            speed = motion[1, k, axis]
            one_sided = row[at.VISCOUS_POSITIVE] if speed >= 0.0 else row[at.VISCOUS_NEGATIVE]
            force = (row[at.MASS] - carried) * motion[2, k, axis]
            force += (row[at.VISCOUS] + one_sided) * speed
            force -= spring * own[at.DEFLECTION] + damper * own[at.DEFLECTION_RATE]
            force += stiffness * own[at.BRISTLE]
            if creep > 0.0:
                force += yielding(row, own, creep, motion[0, k, axis], speed)
            force -= _step_own(axes, axis, period, k, motion[:, k], force, own)
            out[k, axis] = force


@compiled
def run_windows(
    arrays: KernelArrays,
    work: Work,
    states: np.ndarray,
    force: np.ndarray,
    window: int,
    simulated: np.ndarray,
    simulated_velocity: np.ndarray,
) -> None:
    """Open-loop runs of `window` ticks, each from the recorded state at its first tick.

    Parameters
    ----------
    states : (n, n_axes, STATE_WIDTH)
        See :func:`follow_hidden_states`.
    force : (n_axes, n)
        Commanded force [N].
    simulated, simulated_velocity : (n, n_axes), written
    """
    width = states.shape[1]
    state, _, _, external = work
    for k in range(states.shape[0]):
        for axis in range(width):
            if k % window == 0:
                _copy(states[k, axis], state[axis])
            simulated[k, axis] = state[axis, at.POSITION]
            simulated_velocity[k, axis] = state[axis, at.VELOCITY]
        advance(arrays, state, force, k, external)
