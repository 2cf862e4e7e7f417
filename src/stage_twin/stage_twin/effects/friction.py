"""What the frictions have in common: parameters, bristles that bend, a curve over the speed."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stage_core.arrays import Array
from stage_twin.effects.definition import Parameter
from stage_twin.effects.rows import ForceRows, Signal

#: Presliding [m] beside which a friction holds firmly. A longer one may let the loop hunt, and the
#: low-pass of the force balance hides which it is.
DRY = 1e-7
#: What fits get wrong of a friction near standstill, where no two models of one agree: of 25 fits
#: of seven simulators the middle one missed the presliding by 36 % and the breakaway by 2 %, and
#: one in ten the breakaway by 22 % and the Stribeck velocity by 9 %.
DOUBTED_PRESLIDING, DOUBTED_BREAKAWAY, DOUBTED_VELOCITY = 0.4, 0.12, 0.1
#: The same of a sliding force: of 16 right ones of four simulators the middle one missed by less
#: than 0.1 %, four by 1 to 5 % and one by 31 %.
DOUBTED_LEVEL = 0.01
PRESLIDING = Parameter(
    'presliding',
    'm',
    0.0,
    1e-3,
    1e-6,
    'displacement over which the force builds up after a reversal (bristle deflection when it '
    'slides or breaks away); 0 is dry friction',
    neutral=None,
    doubt=DOUBTED_PRESLIDING,
    tried=(0.0, DRY),
)
#: A friction that is a smooth function of the speed, as lubricated contacts and many simulators
#: have it (Andersson, Soderberg, Bjorklund, "Friction models for sliding dry, boundary and mixed
#: lubricated contacts", Tribology International 40, 2007).
CREEP = Parameter(
    'creep_velocity',
    'm/s',
    0.0,
    1e-2,
    0.0,
    'speed below which the friction gives way, as level * tanh(v / creep_velocity), whatever the '
    'presliding; 0 holds the axis',
    neutral=None,
    fitted=False,
    tried=(2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3),
)
#: Shortest pre-sliding displacement [m]; below it friction is dry for any encoder.
SHORTEST_PRESLIDING = 1e-9
#: Longest one that is looked for [m], and as a share of the travel: large machines are softer.
LONGEST_PRESLIDING, OF_TRAVEL = 20e-6, 1.0 / 3000.0
PRESLIDING_GRID = (0.0, 0.05, 0.15, 0.4, 0.75)  # as shares of the longest one
CURVE_KNOTS = (0.0, 3e-3, 1e-2, 3e-2, 1e-1, 3e-1)  # m/s


def friction_force(
    name: str, when_on: float, meaning: str, doubt: float = DOUBTED_LEVEL
) -> Parameter:
    """A level of friction [N]."""
    return Parameter(name, 'N', 0.0, 5000.0, when_on, meaning, doubt=doubt)


def viscous(name: str, when_on: float, meaning: str) -> Parameter:
    """A viscous coefficient [N·s/m]."""
    return Parameter(name, 'N·s/m', -500.0, 2e4, when_on, meaning)


def gives_way(creep_velocity: float) -> float:
    """Speed below which the friction gives way [m/s]; 0 where it holds."""
    return creep_velocity


@njit(cache=True)
def presliding_state(position: Array, presliding: float) -> Array:
    """Friction as a share of its sliding value, -1 … 1, from the path of a position (n,) [m].

    dz/dp = (1 - z sign(dp)) / presliding, integrated exactly over each step (Dahl 1968).
    """
    out = np.zeros(len(position))
    z = 0.0
    for k in range(1, len(position)):
        step = position[k] - position[k - 1]
        if step != 0.0:
            towards = 1.0 if step > 0.0 else -1.0
            if presliding > 0.0:
                z = towards + (z - towards) * math.exp(-abs(step) / presliding)
            else:
                z = towards
        out[k] = z
    return out


def bristles(rows: ForceRows, presliding: float) -> Signal:
    """:func:`presliding_state` of the axis in each session."""
    return [presliding_state(p, presliding) for p in rows.position()]


def longest_presliding(rows: ForceRows) -> float:
    """Longest pre-sliding displacement that is looked for [m]."""
    travel = max(float(np.ptp(p)) for p in rows.position())
    return max(LONGEST_PRESLIDING, OF_TRAVEL * travel)


def presliding_grid(rows: ForceRows) -> list[float]:
    """Pre-sliding displacements from which a search starts [m], those of the twin among them."""
    longest = longest_presliding(rows)
    known = [min(value, longest) for value in rows.known(PRESLIDING.name)]
    return sorted({*known, *(share * longest for share in PRESLIDING_GRID)})


def speed_curve(rows: ForceRows) -> Array:
    """Any function of the speed, for each direction: hats over `CURVE_KNOTS`, (n, k)."""
    hats = []
    for sign in (1.0, -1.0):
        for height in np.eye(len(CURVE_KNOTS)):
            hats.append(
                [
                    np.where(sign * v > 0.0, np.interp(sign * v, CURVE_KNOTS, height), 0.0)
                    for v in rows.smooth_velocity()
                ]
            )
    return rows.columns(*hats)
