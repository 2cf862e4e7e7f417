"""Friction with pre-sliding: bristles that bend, then slide (Dahl; LuGre, eqs. 6-7 of paper 3)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stage_twin import layout as at

#: Shortest pre-sliding displacement [m]; below it friction is dry for any encoder.
SHORTEST_PRESLIDING = 1e-9
#: Newton steps of the implicit friction law; the iteration is monotone and needs 1 to 5.
FRICTION_STEPS = 12


@njit(cache=True)
def sliding_force(row: np.ndarray, velocity: float, positive: bool) -> float:
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
    stribeck = row[at.STRIBECK_COULOMB] + row[at.STRIBECK_BREAKAWAY]
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
    reach = sliding_force(row, velocity, positive) / stiffness
    if reach <= 0.0:
        return 0.0
    end = reach if positive else -reach
    return end + (bristle - end) * math.exp(-abs(velocity) * step / reach)


@njit(cache=True)
def solve_bristle(
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
    reach = sliding_force(row, velocity, positive) / stiffness
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
