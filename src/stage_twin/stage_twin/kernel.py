"""The compiled plant and controller of docs/interfaces.md, "Twin file", with every effect.

Per control tick and axis: encoder, controller, then the plant over one period. The linear
part (masses, viscous friction, spring) advances by its exact discretisation under a held
force; a force delayed by a fraction of a tick splits the tick into two such pieces. Where
friction or a force that depends on position is on, each piece is divided into substeps and
friction is solved implicitly, which stays stable at any stiffness.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stage_twin import layout as at
from stage_twin.friction import bristle_stiffness, solve_bristle


@njit(cache=True)
def load_force(row: np.ndarray, position: float) -> float:
    """Force of offset, ripple and cable on the moving mass [N]."""
    force = row[at.FORCE_OFFSET]
    if row[at.RIPPLE_AMPLITUDE] != 0.0:
        period = (
            row[at.RIPPLE_PERIOD] if row[at.RIPPLE_PERIOD] > at.SHORTEST_LENGTH else row[at.LEAD]
        )
        force += row[at.RIPPLE_AMPLITUDE] * math.sin(
            2.0 * math.pi * position / period + row[at.RIPPLE_PHASE]
        )
    stretch = position - row[at.CABLE_CENTRE]
    stiffness = row[at.CABLE_STIFFNESS] + row[at.CABLE_HARDENING] * stretch * stretch
    return force - stiffness * stretch


@njit(cache=True)
def drive_force(row: np.ndarray, force: float) -> float:
    """Force that the amplifier gives for a commanded one [N]."""
    acting = force * (1.0 + row[at.GAIN_ERROR])
    limit = row[at.SATURATION]
    if limit > 0.0:
        acting = min(max(acting, -limit), limit)
    return acting


@njit(cache=True)
def start_plant(axes: np.ndarray, position: np.ndarray, state: np.ndarray) -> None:
    """State at rest at `position` (n_axes,) [m], the play and the bristles centred."""
    for axis in range(axes.shape[0]):
        state[axis, :] = 0.0
        state[axis, at.POSITION] = position[axis]
        state[axis, at.PLAY] = position[axis]
        state[axis, at.RISE] = axes[axis, at.INITIAL_RISE]


@njit(cache=True)
def advance_axis(
    row: np.ndarray,
    transitions: np.ndarray,
    schedule: np.ndarray,
    state: np.ndarray,
    before: float,
    after: float,
    external: float,
) -> None:
    """Advance one axis over one tick.

    Parameters
    ----------
    before, after : float
        Commanded force in the tick's first piece and in its second [N].
    external : float
        Force on the moving mass from outside, held over the tick [N].
    """
    rough = schedule[1] > 0.0
    stiffness = bristle_stiffness(row) if rough else 0.0
    half_play = 0.5 * row[at.BACKLASH_WIDTH]
    for piece in range(at.PIECES):
        count = int(schedule[2 + 2 * piece])
        step = schedule[3 + 2 * piece]
        acting = drive_force(row, before if piece == 0 else after) + external
        for _ in range(count):
            position = state[at.POSITION]
            velocity = state[at.VELOCITY]
            deflection = state[at.DEFLECTION]
            rate = state[at.DEFLECTION_RATE]
            force = acting + load_force(row, position + 0.5 * step * velocity)
            move = transitions[piece, 1 if velocity >= 0.0 else 0]
            if rough:
                free = (
                    move[1, 1] * velocity
                    + move[1, 2] * deflection
                    + move[1, 3] * rate
                    + move[1, 4] * force
                )
                held, state[at.BRISTLE] = solve_bristle(
                    row, stiffness, state[at.BRISTLE], velocity, free, move[1, 4], step
                )
                force -= stiffness * held
            state[at.POSITION] = (
                position
                + move[0, 1] * velocity
                + move[0, 2] * deflection
                + move[0, 3] * rate
                + move[0, 4] * force
            )
            state[at.VELOCITY] = (
                move[1, 1] * velocity
                + move[1, 2] * deflection
                + move[1, 3] * rate
                + move[1, 4] * force
            )
            state[at.DEFLECTION] = (
                move[2, 1] * velocity
                + move[2, 2] * deflection
                + move[2, 3] * rate
                + move[2, 4] * force
            )
            state[at.DEFLECTION_RATE] = (
                move[3, 1] * velocity
                + move[3, 2] * deflection
                + move[3, 3] * rate
                + move[3, 4] * force
            )
            output = state[at.POSITION] + row[at.RESONANCE_TABLE] * state[at.DEFLECTION]
            state[at.PLAY] = min(max(state[at.PLAY], output - half_play), output + half_play)
            if row[at.HEATING_TIME] > 0.0:
                settled = row[at.HEATING] * abs(velocity)
                state[at.RISE] = settled + (state[at.RISE] - settled) * math.exp(
                    -step / row[at.HEATING_TIME]
                )


@njit(cache=True)
def advance(
    axes: np.ndarray,
    transitions: np.ndarray,
    schedule: np.ndarray,
    state: np.ndarray,
    forces: np.ndarray,
    tick: int,
    external: np.ndarray,
) -> None:
    """Advance every axis over tick `tick`; `forces` (n_axes, depth) is the ring of commands."""
    depth = forces.shape[1]
    for axis in range(axes.shape[0]):
        ticks = int(schedule[axis, 0])
        after = forces[axis, (tick - ticks) % depth] if tick >= ticks else 0.0
        before = forces[axis, (tick - ticks - 1) % depth] if tick > ticks else 0.0
        advance_axis(
            axes[axis],
            transitions[axis],
            schedule[axis],
            state[axis],
            before,
            after,
            external[axis],
        )


@njit(cache=True)
def encoder(row: np.ndarray, position: float) -> float:
    """Encoder reading q [m] of a motor position."""
    resolution = (
        row[at.QUANTUM] if row[at.QUANTUM] > at.SHORTEST_LENGTH else row[at.ENCODER_RESOLUTION]
    )
    return float(np.rint(position / resolution)) * resolution


@njit(cache=True)
def start_controller(encoders: np.ndarray, controller: np.ndarray) -> None:
    """Controller at the start of a session: q_(-1) = q_0, vf_(-1) = 0, I_0 = 0."""
    for axis in range(encoders.shape[0]):
        controller[axis, at.LAST_ENCODER] = encoders[axis]
        controller[axis, at.FILTERED] = 0.0
        controller[axis, at.INTEGRAL] = 0.0


@njit(cache=True)
def velocity_command(
    row: np.ndarray, encoder_position: float, reference: float, reference_velocity: float
) -> float:
    """vc_k of docs/interfaces.md, "Servo controller", without compensation [m/s]."""
    return row[at.VELOCITY_FEEDFORWARD] * reference_velocity + row[at.POSITION_GAIN] * (
        reference - encoder_position
    )


@njit(cache=True)
def estimate_velocity(
    row: np.ndarray, period: float, controller: np.ndarray, encoder_position: float
) -> float:
    """vf_k [m/s] (docs/interfaces.md, "Servo controller"); keeps q_k and vf_k for next tick."""
    decay = math.exp(-period * row[at.VELOCITY_FILTER])
    controller[at.FILTERED] = (
        decay * controller[at.FILTERED]
        + (1.0 - decay) * (encoder_position - controller[at.LAST_ENCODER]) / period
    )
    controller[at.LAST_ENCODER] = encoder_position
    return controller[at.FILTERED]


@njit(cache=True)
def velocity_loop(row: np.ndarray, period: float, controller: np.ndarray, command: float) -> float:
    """F_k [N] for velocity command vc_k (docs/interfaces.md, "Servo controller").

    Advances the integral.
    """
    error = command - controller[at.FILTERED]
    limit = row[at.FORCE_LIMIT]
    raw = row[at.VELOCITY_GAIN] * error + controller[at.INTEGRAL]
    force = min(max(raw, -limit), limit)
    pushes_further = (raw > limit and error > 0.0) or (raw < -limit and error < 0.0)
    if not pushes_further:
        controller[at.INTEGRAL] += row[at.INTEGRAL_GAIN] * error * period
    return force
