"""A screw that grows with heat."""

from __future__ import annotations

import math
from functools import partial

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import TrackerRows
from stage_twin.effects.term import Term, Theta

#: Furthest fixed point [m].
FURTHEST = 2.0
#: Starts of its search [m]; what is far from a short travel is told by nothing but its size.
PLACES = tuple(
    sign * place for place in (2.0, 0.7, 0.25, 0.1, 0.04, 0.015, 0.005) for sign in (-1.0, 1.0)
)
#: Sensor behind the screw [s]: starts of the search and its bound.
LAGS = (-10.0, -3.0, -1.0, 1.0, 3.0, 10.0, 20.0)
LONGEST_LAG = 30.0

#: A sensor is not the screw: of five right findings of two foreign simulators with four and five
#: nodes of heat the coefficient missed by 4 to 20 %, the fixed point by 3 to 21 %.
DOUBT = 0.08

EFFECT = Effect(
    name='thermal_expansion',
    link='kinematic',
    parameters=(
        Parameter(
            'coefficient',
            '1/K',
            -200e-6,
            200e-6,
            11.5e-6,
            'expansion coefficient',
            doubt=DOUBT,
        ),
        Parameter(
            'fixed_point',
            'm',
            -FURTHEST,
            FURTHEST,
            0.0,
            'position that does not move; may lie outside',
            neutral=None,
            doubt=DOUBT,
        ),
        Parameter(
            'initial_rise',
            'K',
            -30.0,
            60.0,
            2.0,
            "screw's temperature at the start above the reference (simulated temperature only)",
            nuisance=True,
            fitted=False,
        ),
        Parameter(
            'heating',
            'K·s/m',
            0.0,
            500.0,
            20.0,
            'steady rise per mean speed (simulated temperature only)',
            fitted=False,
        ),
        Parameter(
            'time_constant',
            's',
            1.0,
            1e5,
            600.0,
            "time constant of the screw's temperature (simulated temperature only)",
            fitted=False,
            neutral=None,
        ),
    ),
    model='coefficient * (T_screw - T_reference) * (p - fixed_point); without a recorded '
    'temperature the screw is one thermal mass heated in proportion to speed. Mayr et al., '
    '"Thermal issues in machine tools", CIRP Annals 61 (2012).',
    sentence='the screw grows by {coefficient} with its temperature',
    states=('rise',),
    excited_by='the same grid cold and warm',
)


def start(state: Array, initial_rise: float) -> None:
    """The screw as warm as the session finds it."""
    state[0] = initial_rise


def heat(
    state: Array, velocity: float, step: float, heating: float, time_constant: float
) -> float:
    """Temperature of the screw above the reference after a step [K]."""
    settled = heating * abs(velocity)
    state[0] = settled + (state[0] - settled) * math.exp(-step / time_constant)
    return state[0]


def along(played: float, rise: float, coefficient: float, fixed_point: float) -> float:
    """Displacement of the table along the axis [m]."""
    return coefficient * rise * (played - fixed_point)


def term(rows: TrackerRows) -> Term | None:
    """The rise of the temperature times the distance from the fixed point."""
    if rows.temperature_rise() is None:
        return None
    return _term(rows, tuple((place,) for place in (0.0, *PLACES)))


def _term(rows: TrackerRows, grid: tuple[Theta, ...]) -> Term:
    """θ is the fixed point [m] and, where it is searched, how late the sensor is [s].

    The sensor may be ahead of the screw. Far from the fixed point the coefficient is known with
    it alone: their product is what the tracker sees.
    """

    def columns(theta: Theta) -> Array:
        fixed_point, *lag = theta
        rises = rows.temperature_rise(*lag)
        assert rises is not None
        return rows.along(
            [
                (rise * (position - fixed_point))[:, None]
                for rise, position in zip(rises, rows.position(), strict=True)
            ]
        )

    searched = len(grid[0]) > 1
    limits = (FURTHEST, LONGEST_LAG)[: len(grid[0])]
    late = tuple((*place, lag) for place in grid for lag in LAGS)
    return Term(
        columns,
        lambda theta, c: {'coefficient': float(c[0]), 'fixed_point': theta[0]},
        grid=grid,
        lower=tuple(-limit for limit in limits),
        upper=limits,
        # Screws grow with heat; a shrinking one is a drift of another kind.
        admissible=lambda theta, c: c[0] > 0.0,
        steps=(1e-3, 0.3)[: len(grid[0])],
        richer=None if searched or rows.rests else partial(_term, rows, late),
    )
