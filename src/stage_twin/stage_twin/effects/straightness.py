"""A guide that is not straight: it displaces the other axis."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.polynomial.legendre import legval

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import TrackerRows
from stage_twin.effects.shared import (
    CENTRE,
    HALF_RANGE,
    ORDERS,
    roughness,
    within_seen,
)
from stage_twin.effects.term import Term, Theta, constant

#: Largest travel of the guide over that of the session, on which the guide's line may be defined.
WIDEST = 1.5
#: Largest offset of the reference line as a share of the curve's largest factor: that of a bow
#: whose line is the one over twice the travel of the session.
FARTHEST = 1.5
#: What the slope of the reference line counts as rough beside all orders, see `Term.roughness`. Of
#: two guides 1e-4 predicted one badly and 1e-2 the other.
LINE = 1e-3
_HIGHER = tuple(
    Parameter(f'p{k}', 'm', -1e-3, 1e-3, 0.0, f'factor of P{k}(s)') for k in range(4, ORDERS + 1)
)
NAMES = ('quadratic', 'cubic', *(parameter.name for parameter in _HIGHER))

EFFECT = Effect(
    name='straightness',
    link='kinematic',
    parameters=(
        Parameter('quadratic', 'm', -1e-3, 1e-3, 4e-6, 'bow: factor of P2(s)'),
        Parameter('cubic', 'm', -1e-3, 1e-3, 0.0, 'S shape: factor of P3(s)'),
        *_HIGHER,
        Parameter('slope', 'm', -1e-3, 1e-3, 0.0, 'factor of s: reference line'),
        Parameter('offset', 'm', -1e-3, 1e-3, 0.0, 'offset of the reference line'),
        CENTRE,
        HALF_RANGE,
    ),
    model='Displaces the other axis by quadratic * P2(s) + cubic * P3(s) + p4 * P4(s) and so on, '
    's = (p - centre) / half_range. Legendre polynomials have no least-squares line over the '
    'range; slope * s + offset makes it the line over other points. ISO 230-1:2012; ISO/TR '
    '16907:2015.',
    sentence='the guide is bent: it displaces the other axis by up to {quadratic} (bow) and '
    '{cubic} (S shape)',
    excited_by='the whole travel at a fixed place of the other axis',
    seen_by_encoder=False,
)


def across(
    position: float,
    quadratic: float,
    cubic: float,
    p: Array,
    slope: float,
    offset: float,
    centre: float,
    half_range: float,
) -> float:
    """Displacement of the other axis [m]; beyond the range it is that of its end."""
    s = min(max((position - centre) / half_range, -1.0), 1.0)
    second = 0.5 * (3.0 * s * s - 1.0)
    third = 0.5 * (5.0 * s * s - 3.0) * s
    total = offset + slope * s + quadratic * second + cubic * third
    before, last = second, third
    for k in range(p.shape[0]):
        # Bonnet's recursion from the orders before.
        before, last = last, ((2.0 * k + 7.0) * s * last - (k + 3.0) * before) / (k + 4.0)
        total += p[k] * last
    return total


def term(rows: TrackerRows) -> Term | None:
    """Legendre polynomials from the second order on over the travel, across the axis."""
    return _plain(rows) if len(rows.axes) == 2 else None


def _plain(rows: TrackerRows) -> Term:
    """Bow and S shape, and an offset; θ says which slope the removed line has.

    At (0, 1) it is the line over the session's travel, which no polynomial has, at (1, 1) that
    over the points as they were measured, at (0, r) that over r times the travel. Which one the
    guide's maker meant, no data say: the slope and the offset belong to the session.
    """
    centre, half = rows.travel
    places = [(position - centre) / half for position in rows.position()]
    curves = [legval(s, np.eye(4)[2:].T).T for s in places]
    slope = np.polyfit(np.concatenate(places), np.concatenate(curves), 1)[0]  # (2,)
    between, visited = not rows.rests, np.concatenate(places)

    def removed(theta: Theta) -> Array:
        # The least-squares line of P3 over -r to r; that of P2 has no slope.
        return np.asarray(theta[0] * slope + [0.0, 1.5 * (theta[1] ** 2 - 1.0)])

    def columns(theta: Theta) -> Array:
        if not between:
            return rows.across(curves)
        return rows.across(
            [
                np.column_stack([c - np.outer(s, removed(theta)), np.ones(len(s))])
                for s, c in zip(places, curves, strict=True)
            ]
        )

    def parameters(theta: Theta, c: Array) -> dict[str, float]:
        return {
            **dict(zip(NAMES, c[:2].tolist(), strict=False)),
            'slope': -float(removed(theta) @ c[:2]) if theta else 0.0,
            'offset': float(c[-1]) if between else 0.0,
            'centre': centre,
            'half_range': half,
        }

    def admissible(theta: Theta, c: Array) -> bool:
        largest = float(np.max(np.abs(c[:2])))
        if largest >= 1e-3 or not between:
            return largest < 1e-3
        curve = np.array([0.0, -float(removed(theta) @ c[:2]), *c[:2]])
        return abs(c[-1]) <= FARTHEST * largest and within_seen(curve, visited)

    return Term(
        columns,
        parameters,
        grid=((0.0, 1.0), (1.0, 1.0), (0.0, 1.3)) if between else ((),),
        lower=(-0.3, 1.0) if between else (),
        upper=(1.3, WIDEST) if between else (),
        admissible=admissible,
        richer=partial(_any, rows) if between else None,
        roughness=np.append(roughness(2, 3), [0.0] * between),
    )


def _any(rows: TrackerRows) -> Term:
    """All orders, beside the slope and the offset of a reference line.

    θ cannot say which line the maker removed: beyond the travel high orders grow without bound.
    The slope is a coefficient instead, and is kept small where the points do not tell it (`LINE`).
    """
    centre, half = rows.travel
    places = [(position - centre) / half for position in rows.position()]
    curves = [legval(s, np.eye(ORDERS + 1)).T for s in places]  # from P0 on
    visited = np.concatenate(places)

    def admissible(theta: Theta, c: Array) -> bool:
        largest = float(np.max(np.abs(c[2:])))
        line = float(np.max(np.abs(c[:2])))
        return largest < 1e-3 and line <= FARTHEST * largest and within_seen(c, visited)

    def parameters(theta: Theta, c: Array) -> dict[str, float]:
        found = dict(zip(('offset', 'slope', *NAMES), c.tolist(), strict=True))
        return {**found, 'centre': centre, 'half_range': half}

    return Term(
        constant(rows.across(curves)),
        parameters,
        admissible=admissible,
        own=True,
        roughness=np.concatenate([[0.0, LINE], roughness(2, ORDERS)]),
    )
