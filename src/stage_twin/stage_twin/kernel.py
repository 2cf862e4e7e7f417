"""The compiled plant and controller of section 5 of the contract, with every effect.

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

#: Longest substep while friction or a force over position is on [s].
LONGEST_SUBSTEP = 2.5e-4
#: Shortest pre-sliding displacement [m]; below it friction is dry for any encoder.
SHORTEST_PRESLIDING = 1e-9
#: Newton steps of the implicit friction law; the iteration is monotone and needs 1 to 5.
FRICTION_STEPS = 12
# Four states and the held force.
_AUGMENTED = 5


@njit(cache=True)
def _exponential(matrix: np.ndarray) -> np.ndarray:
    """exp of a small matrix by scaling, Taylor series and squaring."""
    size = matrix.shape[0]
    norm = np.abs(matrix).sum(axis=1).max()
    halvings = 0
    while norm > 0.25:
        norm *= 0.5
        halvings += 1
    scaled = matrix / 2.0**halvings
    result = np.eye(size)
    term = np.eye(size)
    for order in range(1, 14):
        term = term @ scaled / order
        result = result + term
    for _ in range(halvings):
        result = result @ result
    return result


@njit(cache=True)
def discretise(
    axes: np.ndarray, period: float, transitions: np.ndarray, schedule: np.ndarray
) -> None:
    """Exact transitions of the linear plant over one substep of each piece of a tick.

    Parameters
    ----------
    axes : (n_axes, AXIS_WIDTH)
    period : float
        Tick [s].
    transitions : (n_axes, PIECES, DIRECTIONS, MOTION, MOTION + 1), written
        The last column is the gain of the held force.
    schedule : (n_axes, 2 + 2 * PIECES), written
        Whole ticks of delay, 1 where friction is on, then per piece the number of substeps
        and the length of one [s].
    """
    for axis in range(axes.shape[0]):
        row = axes[axis]
        delay = row[at.DELAY] + row[at.DELAY_ADDED]
        ticks = math.floor(delay / period + 1e-9)
        fraction = max(0.0, delay - ticks * period)
        if fraction < 1e-9 * period:
            fraction = 0.0
        rough = (
            row[at.COULOMB] > 0.0
            or row[at.ASYMMETRIC_POSITIVE] > 0.0
            or row[at.ASYMMETRIC_NEGATIVE] > 0.0
            or row[at.STRIBECK_COULOMB] > 0.0
            or row[at.STRIBECK_BREAKAWAY] > 0.0
        )
        divided = (
            rough
            or row[at.RIPPLE_AMPLITUDE] != 0.0
            or row[at.CABLE_STIFFNESS] != 0.0
            or row[at.CABLE_CURVATURE] != 0.0
            or row[at.VISCOUS_POSITIVE] != row[at.VISCOUS_NEGATIVE]
        )
        schedule[axis, 0] = ticks
        schedule[axis, 1] = 1.0 if rough else 0.0
        for piece in range(at.PIECES):
            length = fraction if piece == 0 else period - fraction
            count = 0
            if length > 0.0:
                count = max(1, math.ceil(length / LONGEST_SUBSTEP - 1e-9)) if divided else 1
            step = length / count if count > 0 else 0.0
            schedule[axis, 2 + 2 * piece] = count
            schedule[axis, 3 + 2 * piece] = step
            for direction in range(at.DIRECTIONS):
                _transition(row, direction, step, transitions[axis, piece, direction])


@njit(cache=True)
def _transition(row: np.ndarray, direction: int, step: float, out: np.ndarray) -> None:
    mass = row[at.MASS] * (1.0 + row[at.INERTIA_RATIO])
    one_sided = row[at.VISCOUS_POSITIVE] if direction == 1 else row[at.VISCOUS_NEGATIVE]
    viscous = row[at.VISCOUS] + row[at.VISCOUS_ADDED] + one_sided
    carried = 0.0
    stiffness = 0.0
    damping = 0.0
    if row[at.RESONANCE_FREQUENCY] > 0.0 and row[at.RESONANCE_RATIO] > 0.0:
        natural = 2.0 * math.pi * row[at.RESONANCE_FREQUENCY]
        carried = mass * row[at.RESONANCE_RATIO]
        stiffness = carried * natural**2
        damping = 2.0 * row[at.RESONANCE_DAMPING] * carried * natural
    motor = mass - carried
    system = np.zeros((_AUGMENTED, _AUGMENTED))
    system[0, 1] = 1.0
    system[1, 1] = -viscous / motor
    system[1, 2] = stiffness / motor
    system[1, 3] = damping / motor
    system[1, 4] = 1.0 / motor
    if carried > 0.0:
        # Deflection = carried mass - motor; its acceleration is the difference of both.
        system[2, 3] = 1.0
        system[3, 1] = viscous / motor
        system[3, 2] = -stiffness / carried - stiffness / motor
        system[3, 3] = -damping / carried - damping / motor
        system[3, 4] = -1.0 / motor
    out[:, :] = _exponential(system * step)[: at.MOTION, :]


@njit(cache=True, inline='always')
def _sliding_force(row: np.ndarray, velocity: float, positive: bool) -> float:
    """Friction in steady sliding, magnitude [N]."""
    force = row[at.COULOMB] + row[at.STRIBECK_COULOMB]
    if row[at.STRIBECK_BREAKAWAY] != 0.0:
        ratio = velocity / row[at.STRIBECK_VELOCITY]
        force += row[at.STRIBECK_BREAKAWAY] * math.exp(-ratio * ratio)
    if positive:
        return force + row[at.ASYMMETRIC_POSITIVE]
    return force + row[at.ASYMMETRIC_NEGATIVE]


@njit(cache=True)
def bristle_stiffness(row: np.ndarray) -> float:
    """Pre-sliding stiffness of all friction of an axis together [N/m]."""
    mean = 0.5 * (row[at.ASYMMETRIC_POSITIVE] + row[at.ASYMMETRIC_NEGATIVE])
    stribeck = row[at.STRIBECK_COULOMB]
    if stribeck == 0.0:
        stribeck = row[at.STRIBECK_BREAKAWAY]
    return (
        row[at.COULOMB] / max(row[at.COULOMB_PRESLIDING], SHORTEST_PRESLIDING)
        + mean / max(row[at.ASYMMETRIC_PRESLIDING], SHORTEST_PRESLIDING)
        + stribeck / max(row[at.STRIBECK_PRESLIDING], SHORTEST_PRESLIDING)
    )


@njit(cache=True)
def slide_bristle(
    row: np.ndarray, stiffness: float, bristle: float, velocity: float, step: float
) -> float:
    """Bristle deflection after `step` at constant velocity: dz/dt = v - |v| z / g, exact [m]."""
    positive = velocity >= 0.0
    reach = _sliding_force(row, velocity, positive) / stiffness
    if reach <= 0.0:
        return 0.0
    end = reach if positive else -reach
    return end + (bristle - end) * math.exp(-abs(velocity) * step / reach)


@njit(cache=True)
def _friction(
    row: np.ndarray,
    stiffness: float,
    bristle: float,
    velocity: float,
    free: float,
    gain: float,
    step: float,
) -> float:
    """Bristle deflection at the end of a step whose end velocity friction itself decides.

    Solves v = free - gain * stiffness * z(v), z(v) the exact bristle law over `step`. z grows
    with v and its slope falls with |v|, so Newton from the side of standstill is monotone.
    """
    excess = free - gain * stiffness * bristle
    positive = excess >= 0.0
    sign = 1.0 if positive else -1.0
    reach = _sliding_force(row, velocity, positive) / stiffness
    if reach <= 0.0:
        return 0.0
    target = sign * free
    start = sign * bristle
    speed = max(0.0, sign * velocity)
    end = start
    for _ in range(FRICTION_STEPS):
        decay = math.exp(-speed * step / reach)
        end = reach + (start - reach) * decay
        balance = speed + gain * stiffness * end - target
        slope = 1.0 + gain * stiffness * (reach - start) * decay * step / reach
        change = balance / slope
        new_speed = max(0.0, speed - change)
        if abs(new_speed - speed) <= 1e-12 + 1e-9 * speed:
            speed = new_speed
            break
        speed = new_speed
    return sign * (reach + (start - reach) * math.exp(-speed * step / reach))


@njit(cache=True)
def load_force(row: np.ndarray, position: float) -> float:
    """Force of offset, ripple and cable on the moving mass [N]."""
    force = row[at.FORCE_OFFSET]
    if row[at.RIPPLE_AMPLITUDE] != 0.0:
        period = row[at.RIPPLE_PERIOD] if row[at.RIPPLE_PERIOD] > 0.0 else row[at.LEAD]
        force += row[at.RIPPLE_AMPLITUDE] * math.sin(
            2.0 * math.pi * position / period + row[at.RIPPLE_PHASE]
        )
    stretch = position - row[at.CABLE_CENTRE]
    return force - (row[at.CABLE_STIFFNESS] + row[at.CABLE_CURVATURE] * stretch) * stretch


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
                bristle = _friction(
                    row, stiffness, state[at.BRISTLE], velocity, free, move[1, 4], step
                )
                state[at.BRISTLE] = bristle
                force -= stiffness * bristle
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
    resolution = row[at.QUANTUM] if row[at.QUANTUM] > 0.0 else row[at.ENCODER_RESOLUTION]
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
    """vc_k of the contract without compensation [m/s]."""
    return row[at.VELOCITY_FEEDFORWARD] * reference_velocity + row[at.POSITION_GAIN] * (
        reference - encoder_position
    )


@njit(cache=True)
def estimate_velocity(
    row: np.ndarray, period: float, controller: np.ndarray, encoder_position: float
) -> float:
    """vf_k of the contract [m/s]; keeps q_k and vf_k for the next tick."""
    decay = math.exp(-period * row[at.VELOCITY_FILTER])
    controller[at.FILTERED] = (
        decay * controller[at.FILTERED]
        + (1.0 - decay) * (encoder_position - controller[at.LAST_ENCODER]) / period
    )
    controller[at.LAST_ENCODER] = encoder_position
    return controller[at.FILTERED]


@njit(cache=True)
def velocity_loop(row: np.ndarray, period: float, controller: np.ndarray, command: float) -> float:
    """F_k of the contract [N] for velocity command vc_k; advances the integral."""
    error = command - controller[at.FILTERED]
    limit = row[at.FORCE_LIMIT]
    raw = row[at.VELOCITY_GAIN] * error + controller[at.INTEGRAL]
    force = min(max(raw, -limit), limit)
    pushes_further = (raw > limit and error > 0.0) or (raw < -limit and error < 0.0)
    if not pushes_further:
        controller[at.INTEGRAL] += row[at.INTEGRAL_GAIN] * error * period
    return force
