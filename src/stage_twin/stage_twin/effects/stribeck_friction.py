"""Stribeck friction: the sliding force falls with speed near standstill (LuGre)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.friction import (
    CREEP,
    DOUBTED_BREAKAWAY,
    DOUBTED_VELOCITY,
    PRESLIDING,
    SHORTEST_PRESLIDING,
    bristles,
    friction_force,
    gives_way,
    longest_presliding,
    presliding_grid,
    speed_curve,
)
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term, Theta

#: Bounds of the Stribeck velocity and starts of its search [m/s].
SLOWEST, FASTEST = 1e-4, 0.2
STRIBECK_GRID = (3e-4, 1e-3, 3e-3, 8e-3, 20e-3, 60e-3)
#: Exponents of the curve that were measured (Armstrong-Helouvry, "Control of machines with
#: friction", 1991, names 0.5 to 2 and more), that of a Gaussian curve, and starts of other ones.
LEAST_EXPONENT, MOST_EXPONENT, GAUSSIAN, EXPONENTS = 0.4, 3.0, 2.0, (0.7, 1.2, 2.0)

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
        Parameter(
            'exponent',
            '',
            LEAST_EXPONENT,
            MOST_EXPONENT,
            GAUSSIAN,
            'of the speed in the curve',
            neutral=None,
        ),
        PRESLIDING,
        CREEP,
    ),
    model='LuGre friction with sliding force coulomb + breakaway * exp(-(|v| / '
    'stribeck_velocity)^exponent). Canudas de Wit, Olsson, Astrom, Lischinsky, "A new model for '
    'control of systems with friction", IEEE TAC 40 (1995); eqs. 6-7 of paper 3.',
    sentence='friction of {coulomb} rises by {breakaway} below {stribeck_velocity}',
    excited_by='constant-speed strokes from 0.1 to 20 mm/s',
    holds=('coulomb_friction',),
    by_shape=True,
    excludes=('asymmetric_friction', 'position_dependent_friction'),
)


def sliding(
    velocity: float, coulomb: float, breakaway: float, stribeck_velocity: float, exponent: float
) -> float:
    """Level of the friction [N]."""
    ratio = abs(velocity) / stribeck_velocity
    return coulomb + breakaway * math.exp(-(ratio**exponent))


def stiffness(coulomb: float, breakaway: float, presliding: float) -> float:
    """Stiffness before sliding [N/m]."""
    return (coulomb + breakaway) / max(presliding, SHORTEST_PRESLIDING)


creep, signature = gives_way, speed_curve


def term(rows: ForceRows) -> Term:
    """The direction, and the direction near standstill; θ is pre-sliding and velocity.

    In a richer shape the exponent of the curve is the third one. Before, it is the twin's own.
    """
    (usual,) = rows.known('exponent') or (GAUSSIAN,)

    def columns(theta: Theta) -> Array:
        z, exponent = bristles(rows, theta[0]), (*theta, usual)[2]
        near = [np.exp(-((np.abs(v) / theta[1]) ** exponent)) for v in rows.smooth_velocity()]
        return rows.columns(z, [zi * n for zi, n in zip(z, near, strict=True)])

    speeds = sorted({*STRIBECK_GRID, *rows.known('stribeck_velocity')})
    starts = [(g, w) for g in presliding_grid(rows) for w in speeds]
    plain = Term(
        columns,
        lambda theta, c: {
            'coulomb': float(c[0]),
            'breakaway': float(c[1]),
            'stribeck_velocity': theta[1],
            'exponent': (*theta, usual)[2],
            'presliding': theta[0],
        },
        grid=tuple(starts),
        lower=(0.0, SLOWEST),
        upper=(longest_presliding(rows), FASTEST),
        admissible=lambda theta, c: bool(min(c[0], c[1]) > 0.0),
    )
    free = replace(
        plain,
        grid=tuple((*start, e) for start in starts for e in sorted({*EXPONENTS, usual})),
        lower=(*plain.lower, LEAST_EXPONENT),
        upper=(*plain.upper, MOST_EXPONENT),
    )
    return replace(plain, richer=lambda: free)
