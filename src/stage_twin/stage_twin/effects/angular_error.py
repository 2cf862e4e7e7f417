"""Yaw of the carriage, seen with an Abbe arm."""

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

_HIGHER = tuple(
    Parameter(f'p{k}', 'rad', -5e-3, 5e-3, 0.0, f'factor of P{k}(s) in the yaw')
    for k in range(3, ORDERS + 1)
)
NAMES = ('constant', 'linear', 'quadratic', *(parameter.name for parameter in _HIGHER))

EFFECT = Effect(
    name='angular_error',
    link='kinematic',
    parameters=(
        Parameter('linear', 'rad', -5e-3, 5e-3, 40e-6, 'yaw at the end of the travel'),
        Parameter('quadratic', 'rad', -5e-3, 5e-3, 0.0, 'factor of P2(s) in the yaw'),
        *_HIGHER,
        Parameter(
            'arm',
            'm',
            -1.0,
            1.0,
            0.05,
            'Abbe arm from the guide to the point measured',
            neutral=None,
            # A yaw with an arm as long as one likes is an error along the axis by its own place.
            inside=True,
        ),
        CENTRE,
        HALF_RANGE,
        Parameter('constant', 'rad', -5e-3, 5e-3, 0.0, 'yaw at every place'),
    ),
    model='Yaw of the carriage, constant + linear * s + quadratic * P2(s) + p3 * P3(s) and so on, '
    's = (p - centre) / half_range, moves the point along its axis by yaw times the arm plus the '
    'other coordinate: for x -yaw * (y + arm), for y +yaw * (x + arm). Bryan, "The Abbe '
    'principle revisited", Precision Engineering 1 (1979); paper 1, section 2.',
    sentence='the carriage yaws by {linear} from the middle of the travel to its end',
    excited_by='the same line along the axis at two far coordinates of the other axis',
    holds=('scale_error', 'nonorthogonality'),
    seen_by_encoder=False,
)


def turn(
    position: float,
    other: float,
    side: float,
    linear: float,
    quadratic: float,
    p: Array,
    arm: float,
    centre: float,
    half_range: float,
    constant: float,
) -> float:
    """Displacement of the point along the axis [m]; beyond the range as at its end."""
    s = min(max((position - centre) / half_range, -1.0), 1.0)
    before, last = s, 0.5 * (3.0 * s * s - 1.0)
    yaw = constant + linear * s + quadratic * last
    for k in range(p.shape[0]):
        # Bonnet's recursion from the orders before.
        before, last = last, ((2.0 * k + 5.0) * s * last - (k + 2.0) * before) / (k + 3.0)
        yaw += p[k] * last
    return side * yaw * (other + arm)


def term(rows: TrackerRows) -> Term | None:
    """The place over the travel, times the other coordinate and alone."""
    if len(rows.axes) == 1:
        return None if rows.rests else _curved(rows)
    return Term(
        constant(
            rows.along([np.column_stack([y * s[:, 1], s[:, 1]]) for s, y in _shapes(rows, 1)])
        ),
        lambda theta, c: _parameters(rows, np.array([0.0, c[0]]), float(c[1] / c[0])),
        admissible=lambda theta, c: abs(c[0]) < 5e-3 and abs(c[1]) < abs(c[0]),
        richer=None if rows.rests else partial(_curved, rows),
    )


def _curved(rows: TrackerRows) -> Term:
    """All orders of the yaw, the constant too; θ is the arm.

    The constant alone would be `nonorthogonality` and an offset. Where the other coordinate turns
    the point as well, no arm makes a scale error of a yaw.
    """
    shapes = _shapes(rows, ORDERS)
    centre, half = rows.travel
    places = (np.concatenate(rows.position()) - centre) / half

    def admissible(theta: Theta, c: Array) -> bool:
        small = float(np.max(np.abs(c))) < 5e-3 and abs(theta[0]) < 0.99
        return small and within_seen(c, places)

    return Term(
        lambda theta: rows.along([(y + theta[0])[:, None] * s for s, y in shapes]),
        lambda theta, c: _parameters(rows, c, theta[0]),
        grid=tuple((arm,) for arm in (-0.6, -0.3, -0.1, 0.0, 0.1, 0.3, 0.6)),
        lower=(-1.0,),
        upper=(1.0,),
        admissible=admissible,
        roughness=roughness(0, ORDERS),
        holds=False,
        alone=len(rows.axes) == 1,
    )


def _shapes(rows: TrackerRows, highest: int) -> list[tuple[Array, Array]]:
    """Per session the orders of the yaw (m, k), signed as the axis has it; the other place."""
    centre, half = rows.travel
    sign = -1.0 if rows.axis == rows.axes[0] else 1.0
    orders = np.eye(highest + 1)
    alone = len(rows.axes) == 1
    across = [np.zeros(len(p)) for p in rows.position()] if alone else rows.position_across()
    return [
        (sign * legval((position - centre) / half, orders).T, other)
        for position, other in zip(rows.position(), across, strict=True)
    ]


def _parameters(rows: TrackerRows, orders: Array, arm: float) -> dict[str, float]:
    centre, half = rows.travel
    found = dict(zip(NAMES, orders.tolist(), strict=False))
    return {**found, 'arm': arm, 'centre': centre, 'half_range': half}
