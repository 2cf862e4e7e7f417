"""Stribeck friction: the sliding force falls with speed near standstill (LuGre)."""

from __future__ import annotations

import math

import numpy as np

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.friction import (
    DOUBTED_BREAKAWAY,
    DOUBTED_VELOCITY,
    PRESLIDING,
    SHORTEST_PRESLIDING,
    bristles,
    friction_force,
    longest_presliding,
    presliding_grid,
    speed_curve,
)
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Array, Term, Theta

#: Bounds of the Stribeck velocity and starts of its search [m/s].
SLOWEST, FASTEST = 1e-4, 0.2
STRIBECK_GRID = (3e-4, 1e-3, 3e-3, 8e-3, 20e-3, 60e-3)

EFFECT = Effect(
    name='stribeck_friction',
    link='servo',
    parameters=(
        friction_force('coulomb', 10.0, 'sliding force at high speed'),
        friction_force('breakaway', 6.0, 'excess of the force near standstill', DOUBTED_BREAKAWAY),
        Parameter(
            'stribeck_velocity',
            'm/s',
            SLOWEST,
            FASTEST,
            5e-3,
            'speed at which the excess has decayed',
            neutral=None,
            doubt=DOUBTED_VELOCITY,
        ),
        PRESLIDING,
    ),
    model='LuGre friction with sliding force coulomb + breakaway * exp(-(v / stribeck_velocity)^2)'
    '. Canudas de Wit, Olsson, Astrom, Lischinsky, "A new model for control of systems with '
    'friction", IEEE TAC 40 (1995); eqs. 6-7 of paper 3.',
    sentence='friction of {coulomb} rises by {breakaway} below {stribeck_velocity}',
    excited_by='constant-speed strokes from 0.1 to 20 mm/s',
    holds=('coulomb_friction',),
    by_shape=True,
    excludes=('asymmetric_friction', 'position_dependent_friction'),
)


def sliding(velocity: float, coulomb: float, breakaway: float, stribeck_velocity: float) -> float:
    """Level of the friction [N]."""
    ratio = velocity / stribeck_velocity
    return coulomb + breakaway * math.exp(-ratio * ratio)


def stiffness(coulomb: float, breakaway: float, presliding: float) -> float:
    """Stiffness before sliding [N/m]."""
    return (coulomb + breakaway) / max(presliding, SHORTEST_PRESLIDING)


signature = speed_curve


def term(rows: ForceRows) -> Term:
    """The direction, and the direction near standstill; θ is pre-sliding and velocity."""

    def columns(theta: Theta) -> Array:
        z = bristles(rows, theta[0])
        near = [np.exp(-((v / theta[1]) ** 2)) for v in rows.smooth_velocity()]
        return rows.columns(z, [zi * n for zi, n in zip(z, near, strict=True)])

    return Term(
        columns,
        lambda theta, c: {
            'coulomb': float(c[0]),
            'breakaway': float(c[1]),
            'stribeck_velocity': theta[1],
            'presliding': theta[0],
        },
        grid=tuple((g, w) for g in presliding_grid(rows) for w in STRIBECK_GRID),
        lower=(0.0, SLOWEST),
        upper=(longest_presliding(rows), FASTEST),
        admissible=lambda theta, c: bool(min(c[0], c[1]) > 0.0),
    )
