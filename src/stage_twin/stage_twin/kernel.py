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
from stage_twin.friction import solve_bristle, solve_yielding
from stage_twin.packing import KernelArrays


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
def _moved(
    move: np.ndarray, state: np.ndarray, start: float, velocity: float, force: float
) -> float:
    """One row of the discretised linear part times the state, added to `start`."""
    deflection, rate = state[at.DEFLECTION], state[at.DEFLECTION_RATE]
    return start + move[1] * velocity + move[2] * deflection + move[3] * rate + move[4] * force


@compiled
def _step_linear(move: np.ndarray, state: np.ndarray, force: float) -> None:
    """Masses, viscous friction and spring under a force held over a step [N]."""
    velocity = state[at.VELOCITY]
    position = _moved(move[0], state, state[at.POSITION], velocity, force)
    after = _moved(move[1], state, 0.0, velocity, force)
    deflection = _moved(move[2], state, 0.0, velocity, force)
    state[at.DEFLECTION_RATE] = _moved(move[3], state, 0.0, velocity, force)
    state[at.POSITION], state[at.VELOCITY] = position, after
    state[at.DEFLECTION] = deflection


@compiled
def _behind(row: np.ndarray, state: np.ndarray, velocity: float, step: float, time: float) -> None:
    """What follows the motor over a step that began at `velocity`: the play and the screw."""
    output = state[at.POSITION] + row[at.TABLE_SHARE] * state[at.DEFLECTION]
    if row[at.FOLLOW_COLUMN] != 0.0:
        output = hooks.follow(row, state, output, velocity, step, time)
    state[at.PLAYED] = output
    if row[at.HEAT_COLUMN] != 0.0:
        state[at.RISE] = hooks.heat(row, state, velocity, step)


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
        Of the other axis, held over the tick [m/s, m/s²].
    """
    stiffness, creep = schedule[at.BRISTLES], schedule[at.CREEP]
    for piece in range(at.PIECES):
        step = schedule[at.FIRST_PIECE + 2 * piece + 1]
        for _ in range(int(schedule[at.FIRST_PIECE + 2 * piece])):
            position, velocity = state[at.POSITION], state[at.VELOCITY]
            force = before if piece == 0 else after
            # Asked here, as a call costs more than all else of a tick without effects.
            if row[at.DRIVE_COLUMN] != 0.0:
                force = hooks.drive(row, state, force, position, velocity, step, time)
            force += external
            if row[at.FORCE_COLUMN] != 0.0:
                middle = position + 0.5 * step * velocity
                other = other_velocity, other_acceleration
                force += hooks.force(row, state, middle, velocity, force, step, time, *other)
            move = transitions[piece, 1 if velocity >= 0.0 else 0]
            if creep > 0.0:
                free = _moved(move[1], state, 0.0, velocity, force)
                force -= solve_yielding(row, state, creep, position, velocity, free, move[1, 4])
            elif stiffness > 0.0:
                free = _moved(move[1], state, 0.0, velocity, force)
                bristle, gain = state[at.BRISTLE], move[1, 4]
                held, state[at.BRISTLE] = solve_bristle(
                    row, state, stiffness, bristle, position, velocity, free, gain, step
                )
                force -= stiffness * held
            _step_linear(move, state, force)
            _behind(row, state, velocity, step, time)
            time += step


@compiled
def advance(
    arrays: KernelArrays, state: np.ndarray, forces: np.ndarray, tick: int, external: np.ndarray
) -> None:
    """Advance every axis over tick `tick`; `forces` (n_axes, depth) is the ring of commands."""
    axes, schedule, period = arrays.axes, arrays.schedule, arrays.period
    depth = forces.shape[1]
    count = axes.shape[0]
    # An axis that the other one pulls comes after it, so that it feels this tick's motion.
    pulled = count == 2 and axes[0, at.COUPLED_COLUMN] != 0.0
    for turn in range(count):
        axis = count - 1 - turn if pulled else turn
        ticks = int(schedule[axis, at.DELAY_TICKS])
        other_velocity = 0.0
        other_acceleration = 0.0
        if count == 2:
            other_acceleration = state[1 - axis, at.ACCELERATION]
            other_velocity = state[1 - axis, at.VELOCITY]
            if turn == 1:  # of the tick's middle
                other_velocity -= 0.5 * period * other_acceleration
        after = forces[axis, (tick - ticks) % depth] if tick >= ticks else 0.0
        before = forces[axis, (tick - ticks - 1) % depth] if tick > ticks else 0.0
        start = state[axis, at.VELOCITY]
        advance_axis(
            axes[axis],
            arrays.transitions[axis],
            schedule[axis],
            state[axis],
            before,
            after,
            external[axis],
            tick * period,
            other_velocity,
            other_acceleration,
        )
        state[axis, at.ACCELERATION] = (state[axis, at.VELOCITY] - start) / period


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
