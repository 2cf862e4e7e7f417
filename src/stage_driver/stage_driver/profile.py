"""Point-to-point and velocity profiles, one tick at a time, from any state of motion.

A trapezoid generator (speed and acceleration limited, exact landing) feeds a moving average over
`jerk_ticks` ticks, which limits the jerk to acceleration / (jerk_ticks * Ts) and leaves the
reached position exact. A new target may come at any tick.
"""

from __future__ import annotations

import math

from numba import njit

from stage_core.arrays import Array


@njit(cache=True)
def braking_speed(distance: float, acceleration: float, period: float) -> float:
    """Largest speed from which ticks of `acceleration` stop within `distance` (>= 0) [m/s].

    A staircase v = n a Ts + f, f < a Ts, of ticks that decelerate by a Ts travels
    (n + 1) f Ts + n (n + 1) a Ts^2 / 2; this is solved for n, then f.
    """
    unit = acceleration * period * period
    count = math.floor(0.5 * (math.sqrt(1.0 + 8.0 * distance / unit) - 1.0))
    rest = distance - 0.5 * count * (count + 1) * unit
    return count * acceleration * period + rest / ((count + 1) * period)


@njit(cache=True)
def step_to_target(
    position: float, speed: float, target: float, limit: float, acceleration: float, period: float
) -> tuple[float, float]:
    """One tick of the trapezoid: the new (position [m], speed [m/s]); lands exactly."""
    error = target - position
    wanted = min(limit, braking_speed(abs(error), acceleration, period))
    if error < 0.0:
        wanted = -wanted
    change = acceleration * period
    low, high = speed - change, speed + change
    if low <= error / period <= high and abs(error) <= change * period:
        return target, error / period
    speed = min(max(wanted, low), high)
    return position + speed * period, speed


@njit(cache=True)
def step_speed(speed: float, wanted: float, acceleration: float, period: float) -> float:
    """One tick of an acceleration-limited change of speed [m/s]."""
    change = acceleration * period
    return min(max(wanted, speed - change), speed + change)


@njit(cache=True)
def seed_window(window: Array, position: float, speed: float, period: float) -> float:
    """Fill the moving average for a motion under way; return the generator's position [m].

    The average of the seeds is `position`, so the profile goes on without a step.
    """
    count = len(window)
    for i in range(count):
        window[i] = position + speed * period * (0.5 * (count - 1) - i)
    return window[0]


@njit(cache=True)
def step_window(window: Array, newest: float) -> float:
    """Push `newest` into the moving average (newest first); return the average."""
    total = newest
    for i in range(len(window) - 1, 0, -1):
        window[i] = window[i - 1]
        total += window[i]
    window[0] = newest
    return total / len(window)


@njit(cache=True)
def profile_tick(
    generators: Array,
    windows: Array,
    targets: Array,
    speeds: Array,
    accelerations: Array,
    period: float,
    reference: Array,
    rate: Array,
) -> bool:
    """Advance all axes one tick; whether every axis has arrived.

    `generators` (axes, 2): position, speed. `windows` (axes, jerk_ticks). `speeds` and
    `accelerations` (axes,): limits. `reference`, `rate` (axes,): r_k [m] and dr_k [m/s].
    """
    arrived = True
    for i in range(len(targets)):
        position, speed = step_to_target(
            generators[i, 0], generators[i, 1], targets[i], speeds[i], accelerations[i], period
        )
        generators[i, 0], generators[i, 1] = position, speed
        smooth = step_window(windows[i], position)
        settled = True
        for value in windows[i]:
            settled = settled and value == targets[i]
        if settled:
            # The mean of equal numbers may miss them by rounding.
            smooth = targets[i]
        rate[i] = (smooth - reference[i]) / period
        reference[i] = smooth
        if not settled or rate[i] != 0.0:
            arrived = False
    return arrived


@njit(cache=True)
def within(
    velocity: float,
    position: float,
    lower: float,
    upper: float,
    deceleration: float,
    period: float,
) -> float:
    """Velocity that can still brake to rest inside the soft limit ahead [m/s]."""
    room = upper - position if velocity > 0.0 else position - lower
    allowed = braking_speed(max(room, 0.0), deceleration, period)
    if abs(velocity) <= allowed:
        return velocity
    return allowed if velocity > 0.0 else -allowed


@njit(cache=True)
def stream_tick(
    positions: Array,
    velocities: Array,
    encoder: Array,
    lower: Array,
    upper: Array,
    decelerations: Array,
    period: float,
    age: int,
    reference: Array,
    rate: Array,
    command: Array,
    predicted: Array,
) -> int:
    """Follow a streamed set-point that came `age` ticks ago; how many axes had to be slowed.

    `positions`, `velocities` (axes,): the set-point. Fills `reference`, `rate`, `command`, and
    `predicted`: where the stream would be now [m].
    """
    slowed = 0
    for i in range(len(encoder)):
        rate[i] = (positions[i] - reference[i]) / period
        reference[i] = positions[i]
        ahead = reference[i] + age * period * velocities[i]
        predicted[i] = min(max(ahead, lower[i]), upper[i])
        command[i] = within(
            velocities[i], encoder[i], lower[i], upper[i], decelerations[i], period
        )
        if command[i] != velocities[i]:
            slowed += 1
    return slowed
