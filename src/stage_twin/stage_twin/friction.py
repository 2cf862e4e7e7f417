"""Friction with pre-sliding: bristles that bend, then slide (Dahl; LuGre, eqs. 6-7 of paper 3).

A friction that gives way has none: it is level * tanh(v / creep).
"""

from __future__ import annotations

import math

import numpy as np

from stage_twin import hooks
from stage_twin.compiled import compiled

#: Newton steps of the implicit friction law; the iteration is monotone and needs 1 to 5.
FRICTION_STEPS = 12
#: Share of their deflection of sliding that bristles may lack and count as bent: nothing is left
#: to be solved then, which halves the time of a session with friction.
BENT = 1e-9

#: Number above which tanh is 1 in a double, and the least slope that it is given below.
FULL, FLAT = 20.0, 1e-15


@compiled
def slide_bristle(
    row: np.ndarray,
    state: np.ndarray,
    stiffness: float,
    bristle: float,
    position: float,
    velocity: float,
    step: float,
) -> float:
    """Bristle deflection after `step` at constant velocity: dz/dt = v - |v| z / g, exact [m]."""
    positive = velocity >= 0.0
    reach = hooks.sliding(row, state, position, velocity, positive) / stiffness
    if reach <= 0.0:
        return 0.0
    end = reach if positive else -reach
    return end + (bristle - end) * math.exp(-abs(velocity) * step / reach)


@compiled
def yielding(
    row: np.ndarray, state: np.ndarray, creep: float, position: float, velocity: float
) -> float:
    """Friction [N] at a velocity, which gives way below about `creep` [m/s]."""
    level = hooks.sliding(row, state, position, velocity, velocity >= 0.0)
    return level * math.tanh(velocity / creep)


@compiled
def solve_yielding(
    row: np.ndarray,
    state: np.ndarray,
    creep: float,
    position: float,
    velocity: float,
    free: float,
    gain: float,
) -> float:
    """Friction [N] over a step whose velocity friction itself decides (:func:`solve_bristle`).

    It is that at a velocity u between those at the start and at the end, the nearer to the end
    the steeper it is for the step. Newton's steps from below in w = |u| / creep, as the slope
    falls with the speed: creep w + pull tanh(w) = |coasting|.
    """
    level = hooks.sliding(row, state, position, velocity, velocity >= 0.0)
    steep = gain * level
    theta = 0.5 * (1.0 + steep / (creep + steep))
    pull = theta * steep
    coasting = (1.0 - theta) * velocity + theta * free
    target = abs(coasting)
    ratio = max(0.0, target - pull) / creep
    if ratio > FULL:
        return math.copysign(level, coasting)
    for _ in range(FRICTION_STEPS):
        share = math.tanh(ratio)
        missing = target - creep * ratio - pull * share
        move = missing / (creep + pull * max(FLAT, 1.0 - share * share))
        ratio += move
        if abs(move) <= 1e-9 * (1.0 + ratio):
            break
    return math.copysign(level * math.tanh(ratio), coasting)


@compiled
def _settle(
    speed: float,
    target: float,
    pull: float,
    reach: float,
    missing: float,
    to_end: float,
    step: float,
) -> tuple[float, float]:
    """Newton's steps of `solve_bristle` in the direction of sliding, from a first `speed` [m/s].

    `target` is the speed without friction, `pull` what the deflection takes off it [1/s], `reach`
    the deflection of sliding [m], `missing` what the bristles lack of it at the start, `to_end`
    the weight of the end. Returns mean deflection that gives the force, and that at the end.
    A last step that is small enough moves both along their slopes: what is left is its square.
    """
    held = 0.0
    end = 0.0
    for _ in range(FRICTION_STEPS):
        slip = speed * step / reach
        decay = math.exp(-slip)
        if slip > 1e-4:
            mean = (1.0 - decay) / slip
            mean_slope = (decay - mean) / slip
        else:
            mean = 1.0 - slip * (0.5 - slip / 6.0)
            mean_slope = -0.5 + slip / 3.0
        held = reach - missing * (to_end * decay + (1.0 - to_end) * mean)
        end = reach - missing * decay
        falls = to_end * decay - (1.0 - to_end) * mean_slope
        grows = missing * step / reach
        balance = speed + pull * held - target
        slope = 1.0 + pull * grows * falls
        moved = max(-speed, -balance / slope)
        if abs(moved) <= 1e-12 + 1e-6 * speed:
            held += grows * falls * moved
            end += grows * decay * moved
            break
        speed += moved
    return held, end


@compiled
def solve_bristle(
    row: np.ndarray,
    state: np.ndarray,
    stiffness: float,
    bristle: float,
    position: float,
    velocity: float,
    free: float,
    gain: float,
    step: float,
) -> tuple[float, float]:
    """Friction over a step whose velocity friction itself decides.

    The bristles move at u, between the velocity at the start and the one at the end; the force is
    that of a deflection between its mean over the step and its end. Where the bristles are soft
    both stand in the middle (second order); the stiffer they are for the step, the nearer to the
    end (damped, for any stiffness). Solves u = (1 - theta) v + theta (free - gain k z(u)); z grows
    with u and its slope falls with |u|, so that Newton from standstill is monotone.

    Parameters
    ----------
    stiffness : float
        Of the bristles [N/m].
    bristle, position, velocity : float
        Deflection [m], position [m] and velocity [m/s] at the start.
    free : float
        Velocity at the end without friction [m/s].
    gain : float
        Change of that velocity per force held over the step [m/s/N].

    Returns
    -------
    Mean deflection that gives the force, and deflection at the end [m].
    """
    stiff = gain * stiffness * step
    to_end = stiff / (1.0 + stiff)
    theta = 0.5 * (1.0 + to_end)
    pull = theta * gain * stiffness
    coasting = (1.0 - theta) * velocity + theta * free
    # Velocity under the friction of the start: its sign decides, and Stribeck's level takes it.
    guess = coasting - pull * bristle
    positive = guess >= 0.0
    sign = 1.0 if positive else -1.0
    reach = hooks.sliding(row, state, position, guess, positive) / stiffness
    if reach <= 0.0:
        return 0.0, 0.0
    target = sign * coasting
    missing = reach - sign * bristle
    sliding = target - pull * reach
    if sliding > 0.0 and abs(missing) <= BENT * reach:
        return sign * reach, sign * reach
    speed = sliding if sliding > 0.0 else max(0.0, sign * velocity)
    held, end = _settle(speed, target, pull, reach, missing, to_end, step)
    return sign * held, sign * end
