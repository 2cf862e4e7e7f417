"""Coulomb friction whose level goes with the position: a bent rail, dirt, a wiper that pinches."""

from __future__ import annotations

from functools import partial

import numpy as np
from numba import njit

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.friction import (
    CREEP,
    PRESLIDING,
    SHORTEST_PRESLIDING,
    bristles,
    friction_force,
    gives_way,
    longest_presliding,
    presliding_grid,
    speed_curve,
)
from stage_twin.effects.knots import Knots, piece
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term, Theta

KNOTS = Knots(7)  # of the level: the shortest wave that they follow is a third of the travel
#: Least standard deviation of the level along the travel, as a share of its mean.
LEAST_SPREAD = 0.08
#: Share of the mean level by which a knot may lie below none: straight lines between knots miss
#: what is narrow of a smooth curve. It was 0.1 to 0.28 where a true level falls nearly to none.
CUT = 0.33

EFFECT = Effect(
    name='position_dependent_friction',
    link='servo',
    parameters=(
        Parameter('start', 'm', -20.0, 20.0, 0.0, 'position of the first knot', neutral=None),
        Parameter('stop', 'm', -20.0, 20.0, 0.04, 'position of the last knot', neutral=None),
        *(
            friction_force(f'c{k}', 8.0 + k, f'sliding force at knot {k}')
            for k in range(KNOTS.count)
        ),
        *KNOTS.more,
        PRESLIDING,
        CREEP,
    ),
    model='As `coulomb_friction`, with a sliding force through equally spaced knots over the '
    'position, straight between them, plus m half-way between them and q half-way between all of '
    'these. Armstrong-Helouvry, Dupont, Canudas de Wit, "A survey of '
    'models, analysis tools and compensation methods for the control of machines with friction", '
    'Automatica 30 (1994), position-dependent friction.',
    sentence='friction goes with the position, from {c0} at one end of the travel over {c3} in '
    'its middle to {c6} at the other',
    excited_by='slow strokes over the whole travel in both directions',
    holds=('coulomb_friction',),
    excludes=('asymmetric_friction', 'stribeck_friction'),
)


def sliding(position: float, start: float, stop: float, c: Array, m: Array, q: Array) -> float:
    """Level of the friction [N], nowhere below none; held beyond the ends."""
    k, share = piece(position, start, stop, len(c) - 1)
    level = c[k] + share * (c[k + 1] - c[k])
    level += _between(position, start, stop, m) + _between(position, start, stop, q)
    return max(level, 0.0)


@njit(cache=True)
def _between(position: float, start: float, stop: float, m: Array) -> float:
    """Straight lines that are zero at each other knot [N]."""
    k, share = piece(position, start, stop, 2 * len(m))
    return m[k // 2] * (share if k % 2 == 0 else 1.0 - share)


def stiffness(c: Array, presliding: float) -> float:
    """Stiffness before sliding [N/m], that of the mean level."""
    return float(np.mean(c)) / max(presliding, SHORTEST_PRESLIDING)


creep, signature = gives_way, speed_curve


def term(rows: ForceRows) -> Term:
    """The direction near each knot, built up over the pre-sliding displacement (θ).

    Richer are one with middles, and one with quarters.
    """
    return _term(rows, KNOTS.numbers)


def _term(rows: ForceRows, numbers: tuple[int, ...]) -> Term:
    """The first one of some numbers of knots; richer are the others."""
    path = rows.fitted(rows.position())
    start, stop = float(path.min()), float(path.max())
    knots = np.linspace(start, stop, 4 * (KNOTS.count - 1) + 1)
    hats = KNOTS.units(_whole, knots, numbers[0])
    near = [[np.interp(p, knots, hat) for p in rows.position()] for hat in hats]
    along = np.column_stack([np.interp(path, knots, hat) for hat in hats])

    def columns(theta: Theta) -> Array:
        z = bristles(rows, theta[0])
        return rows.columns(*([zi * h for zi, h in zip(z, hat, strict=True)] for hat in near))

    def varies(theta: Theta, c: Array) -> bool:
        """Whether the level is one of friction at every knot, and not the same everywhere."""
        level = along @ c
        least = -CUT * np.mean(level)
        uneven = np.std(level) > LEAST_SPREAD * np.mean(level) > 0.0
        return bool(np.min(c @ hats) > least and uneven)

    return Term(
        columns,
        lambda theta, c: {'start': start, 'stop': stop, 'presliding': theta[0], **_levels(c)},
        grid=tuple((g,) for g in presliding_grid(rows)),
        lower=(0.0,),
        upper=(longest_presliding(rows),),
        admissible=varies,
        roughness=KNOTS.roughness(numbers[0]),
        richer=partial(_term, rows, numbers[1:]) if len(numbers) > 1 else None,
    )


def _levels(c: Array) -> dict[str, float]:
    """Parameters of the level at the knots, not below none, and of what is more between them."""
    return KNOTS.named(np.concatenate([np.maximum(c[: KNOTS.count], 0.0), c[KNOTS.count :]]))


_whole = njit(cache=True)(sliding)
