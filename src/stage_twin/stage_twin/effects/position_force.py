"""Gravity, a counterweight, any smooth force of the position that is no cable chain."""

from __future__ import annotations

import numpy as np

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term, constant

KNOTS = 9  # of the curve: the shortest wave that they follow is a quarter of the travel

EFFECT = Effect(
    name='position_force',
    link='servo',
    parameters=(
        Parameter('start', 'm', -20.0, 20.0, 0.0, 'position of the first knot', neutral=None),
        Parameter('stop', 'm', -20.0, 20.0, 0.01, 'position of the last knot', neutral=None),
        *(
            Parameter(f'c{k}', 'N', -500.0, 500.0, 0.5 * (k - 4.5), f'force at knot {k}')
            for k in range(KNOTS)
        ),
    ),
    model='Force on the moving mass through equally spaced knots over the position, cubic between '
    'them. Catmull and Rom, "A class of local interpolating splines" (1974).',
    sentence='a force that depends on the position pulls the axis: {c0} at one end of the travel, '
    '{c8} at the other',
    excited_by='slow strokes over the whole travel in both directions',
    holds=('cable_force', 'force_offset'),
)


def force(position: float, start: float, stop: float, c: np.ndarray) -> float:
    """Force on the moving mass [N]; held beyond the ends."""
    last = len(c) - 1
    at = min(max((position - start) / max(stop - start, 1e-9), 0.0), 1.0) * last
    k = min(int(at), last - 1)
    t = at - k
    before = c[k - 1] if k > 0 else 2.0 * c[k] - c[k + 1]
    after = c[k + 2] if k + 2 <= last else 2.0 * c[k + 1] - c[k]
    slope = 0.5 * (c[k + 1] - before)
    next_slope = 0.5 * (after - c[k])
    rise = c[k + 1] - c[k]
    return c[k] + t * (
        slope + t * (3.0 * rise - 2.0 * slope - next_slope + t * (slope + next_slope - 2.0 * rise))
    )


def term(rows: ForceRows) -> Term:
    """The curve of one newton at each knot; one that hardly varies is a constant force."""
    path = rows.used(rows.position())
    start, stop = float(path.min()), float(path.max())
    grid = np.linspace(start, stop, 40 * (KNOTS - 1) + 1)
    curves = [np.array([force(p, start, stop, unit) for p in grid]) for unit in np.eye(KNOTS)]
    signals = [[-np.interp(p, grid, curve) for p in rows.position()] for curve in curves]
    return Term(
        constant(rows.columns(*signals)),
        lambda theta, c: (
            {'start': start, 'stop': stop} | {f'c{k}': float(value) for k, value in enumerate(c)}
        ),
        admissible=lambda theta, c: 5.0 * float(np.ptp(c)) > float(np.max(np.abs(c))) < 500.0,
    )
