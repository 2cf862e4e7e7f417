"""LuGre friction (eqs. 6-8 of paper 3), discretised so that it is stable for stiff bristles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from stage_core.arrays import Array
from stage_core.errors import StageError


@dataclass(frozen=True)
class LuGre:
    """Parameters of the LuGre model of one axis; forces in N (or the record's effort unit)."""

    coulomb: float  # F_c [N]
    static: float  # F_s [N]
    stribeck_velocity: float  # v_s [m/s]
    stiffness: float  # sigma_0 [N/m]
    damping: float = 0.0  # sigma_1 [N.s/m]
    viscous: float = 0.0  # sigma_2 [N.s/m]

    def __post_init__(self) -> None:
        positive = (self.coulomb, self.stribeck_velocity, self.stiffness)
        if not (all(value > 0.0 for value in positive) and self.static >= self.coulomb):
            raise StageError(
                'LuGre friction needs coulomb, stribeck_velocity and stiffness above zero, '
                f'and static at least coulomb: {self}'
            )
        if self.damping < 0.0 or self.viscous < 0.0:
            raise StageError(f'LuGre damping and viscous must not be negative: {self}')

    def packed(self) -> Array:
        """Return (6,) for the kernels."""
        return np.array(
            [
                self.coulomb,
                self.static,
                self.stribeck_velocity,
                self.stiffness,
                self.damping,
                self.viscous,
            ]
        )


@njit(cache=True)
def lugre_step(
    parameters: Array, deflection: float, velocity: float, period: float
) -> tuple[float, float]:
    """Advance one tick: return the new bristle deflection [m] and the force [N].

    For constant velocity eq. 6 has the exact solution
    z+ = z_ss + (z - z_ss) exp(-|v| T / g), z_ss = g sign(v), which cannot overshoot: explicit
    Euler diverges once |v| T > 2 g. The damping acts on the tick's mean rate (z+ - z) / T.
    """
    coulomb, static, stribeck, stiffness, damping, viscous = parameters
    ratio = velocity / stribeck
    level = (coulomb + (static - coulomb) * np.exp(-ratio * ratio)) / stiffness
    steady = level if velocity > 0.0 else -level
    decay = np.exp(-abs(velocity) * period / level)
    moved = steady + (deflection - steady) * decay
    force = stiffness * moved + damping * (moved - deflection) / period + viscous * velocity
    return moved, force


@njit(cache=True)
def lugre_force(parameters: Array, velocity: Array, period: float) -> Array:
    """Friction force (n,) [N] along a velocity record (n,), bristles relaxed at the start."""
    force = np.empty(len(velocity))
    deflection = 0.0
    for k in range(len(velocity)):
        deflection, force[k] = lugre_step(parameters, deflection, velocity[k], period)
    return force
