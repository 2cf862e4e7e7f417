"""Gravity, a counterweight, any smooth force of the position that is no cable chain."""

from __future__ import annotations

from functools import partial

import numpy as np
from numba import njit

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.shared import cubic, piece
from stage_twin.effects.term import Array, Term, Theta, constant

KNOTS = 9  # of the curve: the shortest wave that they follow is a quarter of the travel
MIDDLES = KNOTS - 1  # between them, for waves of half that length

EFFECT = Effect(
    name='position_force',
    link='servo',
    parameters=(
        Parameter('start', 'm', -20.0, 20.0, 0.0, 'position of the first knot', neutral=None),
        Parameter('stop', 'm', -20.0, 20.0, 0.01, 'position of the last knot', neutral=None),
        *(
            Parameter(f'c{k}', 'N', -5000.0, 5000.0, 0.5 * (k - 4.5), f'force at knot {k}')
            for k in range(KNOTS)
        ),
        *(
            Parameter(
                f'm{k}', 'N', -5000.0, 5000.0, 0.0, f'more half-way from knot {k} to the next'
            )
            for k in range(MIDDLES)
        ),
    ),
    model='Force on the moving mass through equally spaced knots over the position, cubic between '
    'them, plus a curve of this kind that is zero at the knots and m half-way between. Catmull '
    'and Rom, "A class of local interpolating splines" (1974).',
    sentence='a force that depends on the position pulls the axis: {c0} at one end of the '
    'travel, {c8} at the other',
    excited_by='slow strokes over the whole travel in both directions',
    holds=('cable_force', 'force_offset'),
)


@njit(cache=True)
def curve(position: float, start: float, stop: float, c: Array) -> float:
    """Cubic curve through equally spaced knots [N]; held beyond the ends."""
    last = len(c) - 1
    k, share = piece(position, start, stop, last)
    before = c[k - 1] if k > 0 else 2.0 * c[k] - c[k + 1]
    after = c[k + 2] if k + 2 <= last else 2.0 * c[k + 1] - c[k]
    return cubic(before, c[k], c[k + 1], after, share)


def force(position: float, start: float, stop: float, c: Array, m: Array) -> float:
    """Force on the moving mass [N]; held beyond the ends."""
    k, share = piece(position, start, stop, 2 * len(m))
    fine = cubic(_fine(m, k - 1), _fine(m, k), _fine(m, k + 1), _fine(m, k + 2), share)
    return curve(position, start, stop, c) + fine


@njit(cache=True)
def _fine(m: Array, k: int) -> float:
    """Second curve at knot k of both: zero at every other one, and mirrored at the ends."""
    if k % 2 == 0:
        return 0.0
    if k < 0:
        return -m[0]
    return m[k // 2] if k < 2 * len(m) else -m[-1]


def term(rows: ForceRows) -> Term:
    """The curve of one newton at each knot; one that hardly varies is a constant force."""
    return _term(rows, KNOTS)


def _term(rows: ForceRows, number: int) -> Term:
    """The curves of the first `number` of the knots and the middles between them."""
    path = rows.used(rows.position())
    start, stop = float(path.min()), float(path.max())
    grid = np.linspace(start, stop, 80 * (KNOTS - 1) + 1)
    units = np.eye(KNOTS + MIDDLES)[:number]
    curves = [
        np.array([_both(p, start, stop, unit[:KNOTS], unit[KNOTS:]) for p in grid])
        for unit in units
    ]
    signals = [[-np.interp(p, grid, own) for p in rows.position()] for own in curves]

    def parameters(theta: Theta, c: Array) -> dict[str, float]:
        return {'start': start, 'stop': stop} | dict(zip(NAMES, c.tolist(), strict=False))

    return Term(
        constant(rows.columns(*signals)),
        parameters,
        admissible=lambda theta, c: (
            5.0 * float(np.ptp(c[:KNOTS])) > float(np.max(np.abs(c[:KNOTS])))
        ),
        richer=partial(_term, rows, KNOTS + MIDDLES) if number == KNOTS else None,
    )


_both = njit(cache=True)(force)
NAMES = [f'c{k}' for k in range(KNOTS)] + [f'm{k}' for k in range(MIDDLES)]
