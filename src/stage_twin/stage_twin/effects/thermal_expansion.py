"""A screw that grows with heat."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import TrackerRows
from stage_twin.effects.term import Array, Term, Theta

#: Sensor behind the screw [s]: starts of the search and its bound.
LAGS = tuple((lag,) for lag in (-10.0, -3.0, -1.0, 1.0, 3.0, 10.0, 20.0))
LONGEST_LAG = 30.0

EFFECT = Effect(
    name='thermal_expansion',
    link='kinematic',
    parameters=(
        Parameter('coefficient', '1/K', -50e-6, 50e-6, 11.5e-6, 'expansion coefficient'),
        Parameter(
            'fixed_point',
            'm',
            -2.0,
            2.0,
            0.0,
            'position that does not move; may lie outside',
            neutral=None,
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
    """The rise of the temperature times the position, and alone."""
    if rows.temperature_rise() is None:
        return None
    return _term(rows, ((),))


def _term(rows: TrackerRows, lags: tuple[Theta, ...]) -> Term:
    """θ is how late the sensor is behind the screw, or ahead of it, where that is searched [s]."""

    def columns(theta: Theta) -> Array:
        rises = rows.temperature_rise(*theta)
        assert rises is not None
        return rows.along(
            [
                np.column_stack([rise * position, -rise])
                for rise, position in zip(rises, rows.position(), strict=True)
            ]
        )

    searched = lags != ((),)
    return Term(
        columns,
        lambda theta, c: {'coefficient': float(c[0]), 'fixed_point': float(c[1] / c[0])},
        grid=lags,
        lower=(-LONGEST_LAG,) if searched else (),
        upper=(LONGEST_LAG,) if searched else (),
        # Screws grow with heat; a shrinking one is a drift of another kind.
        admissible=lambda theta, c: 0.0 < c[0] < 50e-6 and abs(c[1]) < 2.0 * abs(c[0]),
        steps=(0.3,) if searched else (),
        richer=None if searched or rows.rests else partial(_term, rows, LAGS),
    )
