"""Motion of both axes under the controller of docs/reference/interfaces.md, "Servo controller".

Leapfrog (kick, drift, kick) in substeps of uneven length: they end where the force changes and
where a tick falls, which may be off the grid. Positions of the carriages are relative to the base.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .friction import friction
from .settings import AxisSettings

# Longest substep [s]; half of it where a stiff play is in the drive.
SUBSTEP = 1e-4
# Columns of the state of one axis.
P, V, LOAD_P, LOAD_V, DRIVE_P, DRIVE_V, BASE_P, BASE_V, FORCE, HEAT, ACCEL = range(11)
Array = np.ndarray
Pair = tuple[AxisSettings, AxisSettings]


@njit(cache=True)
def waves(rows: Array, x: float) -> float:
    """Sum of sines: amplitude, wave number, phase in each row."""
    total = 0.0
    for i in range(len(rows)):
        total += rows[i, 0] * np.sin(rows[i, 1] * x + rows[i, 2])
    return total


@njit(cache=True)
def table(s: AxisSettings, values: Array, p: float) -> float:
    """Linear interpolation of a fine table, constant beyond its ends."""
    if len(values) == 2:  # nothing planted
        return values[0]
    x = min(max((p - s.curve_start) / s.curve_step, 0.0), len(values) - 1.0)
    i = min(int(x), len(values) - 2)
    return values[i] + (x - i) * (values[i + 1] - values[i])


@njit(cache=True)
def contact(s: AxisSettings, gap: float, closing: float) -> float:
    """Force through a play: none within half its width, then spring and damper, softly.

    The edge is a softplus over a fortieth of the width: a real flank has asperities.
    """
    half, edge = 0.5 * s.play, s.play / 40.0
    x = (abs(gap) - half) / edge
    pressed = edge * (x if x > 30.0 else np.log1p(np.exp(x)) if x > -30.0 else 0.0)
    share = pressed / (pressed + edge)
    return np.sign(gap) * s.play_stiffness * pressed + s.play_damping * closing * share


@njit(cache=True)
def drive(s: AxisSettings, state: Array, command: float, h: float) -> float:
    """Force of the motor [N] for a commanded one: clipped, sagging, lagging."""
    wanted = min(max(command, -s.clip), s.clip) * s.gain
    strength = 1.0 - s.sag_force * abs(wanted) - s.sag_speed * abs(state[V])
    state[HEAT] += (min(1.0, wanted**2 / s.limit**2 * 25.0) - state[HEAT]) * h / s.heat_time
    wanted *= max(0.2, strength - s.sag_heat * state[HEAT])
    if s.lag > 0.0:
        state[FORCE] += (wanted - state[FORCE]) * (1.0 - np.exp(-h / s.lag))
    else:
        state[FORCE] = wanted
    return state[FORCE]


@njit(cache=True)
def carriage_force(s: AxisSettings, state: Array, t: float, other: Array) -> float:
    """Forces on the carriage that follow from its place, speed and time [N], without friction."""
    p, v = state[P], state[V]
    stretch = p - s.spring_centre
    side = s.viscous_side[0] if v >= 0.0 else s.viscous_side[1]
    return (
        s.offset
        - (s.viscous + side + s.quadratic * abs(v)) * v
        - (s.spring + s.hardening * stretch**2) * stretch
        + waves(s.ripple, p)
        + table(s, s.force_curve, p)
        + waves(s.shake, t)
        - s.cross_mass * other[ACCEL]
        - s.cross_viscous * other[V]
    )


@njit(cache=True)
def kick(s: AxisSettings, state: Array, motor: float, rest: float, h: float) -> None:
    """Speeds of all bodies of an axis; `rest` is what acts between base and carriage."""
    base = 0.0
    if s.base > 0.0:
        pull = s.base_stiffness * state[BASE_P] + s.base_damping * state[BASE_V]
        base = (-motor - rest - pull) / s.base
        state[BASE_V] += h * base
    on_carriage = rest
    if s.drive_mass > 0.0:
        through = contact(s, state[DRIVE_P] - state[P], state[DRIVE_V] - state[V])
        state[DRIVE_V] += h * ((motor - through) / s.drive_mass - base)
        on_carriage += through
    else:
        on_carriage += motor
    if s.load > 0.0:
        spring = s.load_stiffness * (state[P] - state[LOAD_P])
        spring += s.load_damping * (state[V] - state[LOAD_V])
        state[LOAD_V] += h * (spring / s.load - base)
        on_carriage -= spring
    state[ACCEL] = on_carriage / (s.mass - s.load - s.drive_mass) - base
    state[V] += h * state[ACCEL]


@njit(cache=True)
def substep(
    pair: Pair, state: Array, elements: Array, command: Array, rubbing: Array, t: float, h: float
) -> None:
    """One leapfrog step of both axes; `rubbing` keeps the friction force of the last one."""
    for half in range(2):
        for i in range(2):
            s = pair[i]
            if half == 0:
                motor = drive(s, state[i], command[i], h)
            else:
                motor = state[i, FORCE]
            rest = carriage_force(s, state[i], t + half * h, state[1 - i]) - rubbing[i]
            kick(s, state[i], motor, rest, 0.5 * h)
        if half == 1:
            break
        for i in range(2):
            s = pair[i]
            moved = h * state[i, V]
            for body in (P, LOAD_P, DRIVE_P, BASE_P):
                state[i, body] += h * state[i, body + 1]
            factor = table(s, s.friction_curve, state[i, P])
            rubbing[i] = friction(s, elements[i], state[i, V], moved, h, factor)


@njit(cache=True)
def control(
    s: AxisSettings, memory: Array, measured: float, r: float, rd: float, period: float
) -> tuple[float, float]:
    """One tick: velocity command [m/s] and force [N]; `memory` holds q, vf and the integral."""
    pole = np.exp(-period * s.filter)
    memory[1] = pole * memory[1] + (1.0 - pole) * (measured - memory[0]) / period
    memory[0] = measured
    command = s.feedforward * rd + s.position_gain * (r - measured)
    error = command - memory[1]
    wanted = s.velocity_gain * error + memory[2]
    force = min(max(wanted, -s.limit), s.limit)
    if wanted == force or error * wanted < 0.0:
        memory[2] += s.integral_gain * error * period
    return command, force


@njit(cache=True)
def run(
    pair: Pair, ticks: Array, noise: Array, r: Array, rd: Array, period: float
) -> tuple[Array, Array]:
    """Simulates a session.

    `ticks` are the true times of the control ticks [s] (n,), `noise` [m], `r` and `rd` are
    (n, 2). Returns what the controller knew (n, 2, 4: q, vf, vc, F) and the log (n, 2, 6) of
    positions and speeds of carriage, load and base at the ticks.
    """
    n = len(ticks)
    known, log = np.zeros((n, 2, 4)), np.zeros((n, 2, 6))
    state, elements = np.zeros((2, 11)), np.zeros((2, 4))
    memory, rubbing, command = np.zeros((2, 3)), np.zeros(2), np.zeros(2)
    for i in range(2):
        state[i, P] = state[i, LOAD_P] = state[i, DRIVE_P] = r[0, i]
    for k in range(n):
        for i in range(2):
            s = pair[i]
            p = state[i, P]
            for column in range(6):
                log[k, i, column] = state[i, column if column < 4 else column + 2]
            seen = p + waves(s.wave, p) + noise[k, i]
            q = np.round(seen / s.resolution) * s.resolution
            if k == 0:
                memory[i, 0] = q
            vc, force = control(s, memory[i], q, r[k, i], rd[k, i], period)
            known[k, i] = np.array([q, memory[i, 1], vc, force])
        if k + 1 < n:
            between(pair, state, elements, command, rubbing, known, ticks, k)
    return known, log


@njit(cache=True)
def between(
    pair: Pair, state: Array, elements: Array, command: Array, rubbing: Array, known: Array,
    ticks: Array, k: int,
) -> None:  # fmt: skip
    """From tick k to the next in substeps that end where a delayed force changes."""
    t, end = ticks[k], ticks[k + 1]
    longest = SUBSTEP
    if pair[0].drive_mass > 0.0 or pair[1].drive_mass > 0.0:
        longest = 0.5 * SUBSTEP
    while t < end - 1e-12:
        stop = min(end, t + longest)
        for i in range(2):
            delay = pair[i].delay
            j = k
            # The force of the last tick whose delay is over; the next change ends the substep.
            while j >= 0 and ticks[j] + delay > t + 1e-12:
                if ticks[j] + delay < stop:
                    stop = ticks[j] + delay
                j -= 1
            command[i] = known[j, i, 3] if j >= 0 else 0.0
        substep(pair, state, elements, command, rubbing, t, stop - t)
        t = stop
