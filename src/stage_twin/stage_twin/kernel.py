"""The compiled plant and controller of interfaces.md, "Twin file", with every effect.

Per control tick and axis: encoder, controller, then the plant over one period. The linear
part (masses, viscous friction, spring) advances by its exact discretisation under a held
force; a force delayed by a fraction of a tick splits the tick into two such pieces. Where
friction or a force that depends on position is on, each piece is divided into substeps and
friction is solved implicitly, which stays stable at any stiffness.
"""

from __future__ import annotations

import math

import numpy as np

from stage_twin import hooks
from stage_twin import layout as at
from stage_twin.compiled import compiled
from stage_twin.friction import solve_bristle


@compiled
def start_plant(axes: np.ndarray, position: np.ndarray, state: np.ndarray) -> None:
    """State at rest at `position` (n_axes,) [m], the play and the bristles centred."""
    for axis in range(axes.shape[0]):
        row = axes[axis]
        own = state[axis]
        own[:] = 0.0
        own[at.POSITION] = position[axis]
        hooks.start(row, own, position[axis])
        own[at.PLAYED] = hooks.follow(row, own, position[axis], 0.0, 0.0, 0.0)
        own[at.RISE] = hooks.heat(row, own, 0.0, 0.0)


@compiled
def follow(
    row: np.ndarray, state: np.ndarray, position: float, velocity: float, step: float, time: float
) -> None:
    """Let what lies behind the motor of one axis follow it for a step [s] to a position [m]."""
    state[at.PLAYED] = hooks.follow(row, state, position, velocity, step, time)


@compiled
def advance_axis(
    row: np.ndarray,
    transitions: np.ndarray,
    schedule: np.ndarray,
    state: np.ndarray,
    before: float,
    after: float,
    external: float,
    time: float,
    other_velocity: float,
    other_acceleration: float,
) -> None:
    """Advance one axis over one tick.

    Parameters
    ----------
    before, after : float
        Commanded force in the tick's first piece and in its second [N].
    external : float
        Force on the moving mass from outside, held over the tick [N].
    time : float
        At the tick's start [s].
    other_velocity, other_acceleration : float
        Of the other axis, at the tick's start and over the tick before [m/s, m/s²].
    """
    stiffness = schedule[at.BRISTLES]
    # Asked here, as a call costs more than all else of a tick without effects.
    driven = row[at.DRIVE_COLUMN] != 0.0
    forced = row[at.FORCE_COLUMN] != 0.0
    followed = row[at.FOLLOW_COLUMN] != 0.0
    heated = row[at.HEAT_COLUMN] != 0.0
    for piece in range(at.PIECES):
        count = int(schedule[at.FIRST_PIECE + 2 * piece])
        step = schedule[at.FIRST_PIECE + 2 * piece + 1]
        commanded = before if piece == 0 else after
        for _ in range(count):
            position = state[at.POSITION]
            velocity = state[at.VELOCITY]
            deflection = state[at.DEFLECTION]
            rate = state[at.DEFLECTION_RATE]
            acting = commanded
            if driven:
                acting = hooks.drive(row, state, acting, position, velocity, step, time)
            acting += external
            force = acting
            if forced:
                force += hooks.force(
                    row,
                    state,
                    position + 0.5 * step * velocity,
                    velocity,
                    acting,
                    step,
                    time,
                    other_velocity,
                    other_acceleration,
                )
            move = transitions[piece, 1 if velocity >= 0.0 else 0]
            if stiffness > 0.0:
                free = (
                    move[1, 1] * velocity
                    + move[1, 2] * deflection
                    + move[1, 3] * rate
                    + move[1, 4] * force
                )
                held, state[at.BRISTLE] = solve_bristle(
                    row,
                    state,
                    stiffness,
                    state[at.BRISTLE],
                    position,
                    velocity,
                    free,
                    move[1, 4],
                    step,
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
            output = state[at.POSITION] + row[at.TABLE_SHARE] * state[at.DEFLECTION]
            if followed:
                state[at.PLAYED] = hooks.follow(row, state, output, velocity, step, time)
            else:
                state[at.PLAYED] = output
            if heated:
                state[at.RISE] = hooks.heat(row, state, velocity, step)
            time += step


@compiled
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
    count = axes.shape[0]
    period = schedule[0, at.TICK]
    for axis in range(count if count == 2 else 0):
        if axes[count - 1 - axis, at.FORCE_COLUMN] != 0.0:
            velocity = state[axis, at.VELOCITY]
            state[axis, at.ACCELERATION] = (velocity - state[axis, at.LAST_VELOCITY]) / period
            state[axis, at.LAST_VELOCITY] = velocity
    for axis in range(count):
        ticks = int(schedule[axis, at.DELAY_TICKS])
        other_velocity = 0.0
        other_acceleration = 0.0
        if count == 2:
            other_velocity = state[1 - axis, at.LAST_VELOCITY]
            other_acceleration = state[1 - axis, at.ACCELERATION]
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
            tick * period,
            other_velocity,
            other_acceleration,
        )


@compiled
def encoder(row: np.ndarray, state: np.ndarray) -> float:
    """Encoder reading q [m] of an axis' state."""
    resolution = row[at.ENCODER_RESOLUTION]
    position = hooks.read(row, state, state[at.POSITION])
    return float(np.rint(position / resolution)) * resolution


@compiled
def start_controller(encoders: np.ndarray, controller: np.ndarray) -> None:
    """Controller at the start of a session: q_(-1) = q_0, vf_(-1) = 0, I_0 = 0."""
    for axis in range(encoders.shape[0]):
        controller[axis, at.LAST_ENCODER] = encoders[axis]
        controller[axis, at.FILTERED] = 0.0
        controller[axis, at.INTEGRAL] = 0.0


@compiled
def velocity_command(
    row: np.ndarray, encoder_position: float, reference: float, reference_velocity: float
) -> float:
    """vc_k of docs/reference/interfaces.md, "Servo controller", without compensation [m/s]."""
    return row[at.VELOCITY_FEEDFORWARD] * reference_velocity + row[at.POSITION_GAIN] * (
        reference - encoder_position
    )


@compiled
def estimate_velocity(
    row: np.ndarray, period: float, controller: np.ndarray, encoder_position: float
) -> float:
    """vf_k [m/s] (interfaces.md, "Servo controller"); keeps q_k and vf_k for next tick."""
    decay = math.exp(-period * row[at.VELOCITY_FILTER])
    controller[at.FILTERED] = (
        decay * controller[at.FILTERED]
        + (1.0 - decay) * (encoder_position - controller[at.LAST_ENCODER]) / period
    )
    controller[at.LAST_ENCODER] = encoder_position
    return controller[at.FILTERED]


@compiled
def velocity_loop(row: np.ndarray, period: float, controller: np.ndarray, command: float) -> float:
    """F_k [N] for velocity command vc_k (docs/reference/interfaces.md, "Servo controller").

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
