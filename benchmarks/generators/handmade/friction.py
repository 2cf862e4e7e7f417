"""Friction of one carriage: generalised Maxwell slip.

Al-Bender, Lampaert, Swevers, IEEE Trans. Automatic Control 50 (2005): parallel elements, each a
spring that sticks until its share of the friction level is reached and then follows the level with
an attraction rate. The level falls from static to Coulomb friction with the speed.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .settings import SHARES, YIELDS, AxisSettings

# Rate at which a slipping element goes to its level [1/s], and memory of its direction.
ATTRACTION = 400.0
Array = np.ndarray


@njit(cache=True)
def level(s: AxisSettings, speed: float, factor: float) -> float:
    """Friction force of steady sliding at a speed [N]; `factor` is that of the position."""
    coulomb = s.coulomb[0] if speed >= 0.0 else s.coulomb[1]
    if s.static > coulomb:
        drop = np.exp(-((abs(speed) / s.stribeck_speed) ** s.stribeck_power))
        coulomb += (s.static - coulomb) * drop
    return coulomb * factor


@njit(cache=True)
def friction(
    s: AxisSettings, elements: Array, speed: float, moved: float, h: float, factor: float
) -> float:
    """Moves the elements on by `moved` [m] in `h` [s] and returns the force against it [N]."""
    bound = level(s, speed, factor)
    if bound <= 0.0:
        elements[:] = 0.0
        return 0.0
    # What sticks holds up to the static level; the stiffness is that of the Coulomb level.
    stiffness_of = min(bound, max(s.coulomb[0], s.coulomb[1]) * factor)
    total = 0.0
    for i in range(len(elements)):
        share = SHARES[i] * bound
        stiffness = SHARES[i] * stiffness_of / (YIELDS[i] * s.presliding)
        force = elements[i] + stiffness * moved
        if abs(force) > share:
            goal = np.sign(force) * share
            # Above the level of this speed an element sinks to it instead of jumping.
            sunk = goal + (elements[i] - goal) * np.exp(-ATTRACTION * h)
            force = sunk if abs(elements[i]) > share and force * elements[i] > 0.0 else goal
        elements[i] = force
        total += force
    return total
