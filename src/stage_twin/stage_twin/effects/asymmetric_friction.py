"""Friction with a level and a slope of its own in each direction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect
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
    viscous,
)
from stage_twin.effects.rows import ForceRows, Signal
from stage_twin.effects.term import Term, Theta

EFFECT = Effect(
    name='asymmetric_friction',
    link='servo',
    parameters=(
        friction_force('coulomb_positive', 12.0, 'sliding force for v > 0'),
        friction_force('coulomb_negative', 8.0, 'sliding force for v < 0'),
        viscous('viscous_positive', 0.0, 'added viscous coefficient, v > 0'),
        viscous('viscous_negative', 0.0, 'added viscous coefficient, v < 0'),
        PRESLIDING,
        CREEP,
    ),
    model='Friction with a level and a slope of its own in each direction; it holds its Coulomb '
    'part and adds to what else is on. Janot, Gautier, Brunot, "Data set and reference models of '
    'EMPS", Workshop on Nonlinear System Identification Benchmarks (2019), asymmetric model.',
    sentence='friction differs between the directions: {coulomb_positive} forwards, '
    '{coulomb_negative} backwards',
    reverses=True,
    excited_by='strokes in both directions at several speeds',
    holds=('coulomb_friction', 'viscous_friction', 'force_offset'),
    sums=('coulomb_friction', 'viscous_friction'),
    merges=('coulomb_friction', 'force_offset'),
    differ=(('coulomb_positive', 'coulomb_negative'), ('viscous_positive', 'viscous_negative')),
    excludes=('position_dependent_friction', 'stribeck_friction'),
    needs_effort="the mean of the two levels cannot be told from the controller's "
    'integral at the start',
)


def prepare(axis: dict[str, float], viscous_positive: float, viscous_negative: float) -> None:
    """The viscous coefficients of both directions [N·s/m]."""
    axis['viscous_positive'] += viscous_positive
    axis['viscous_negative'] += viscous_negative


def sliding(positive: bool, coulomb_positive: float, coulomb_negative: float) -> float:
    """Level of the friction [N]."""
    return coulomb_positive if positive else coulomb_negative


def stiffness(coulomb_positive: float, coulomb_negative: float, presliding: float) -> float:
    """Stiffness before sliding [N/m]."""
    return 0.5 * (coulomb_positive + coulomb_negative) / max(presliding, SHORTEST_PRESLIDING)


creep, signature = gives_way, speed_curve
LEVELS = ('coulomb_positive', 'coulomb_negative')
SLOPES = ('viscous_positive', 'viscous_negative')


def term(rows: ForceRows) -> Term:
    """The direction of sliding, for both directions; θ is the pre-sliding displacement."""

    def levels(theta: Theta) -> list[Signal]:
        z = bristles(rows, theta[0])
        return [[np.maximum(zi, 0.0) for zi in z], [np.minimum(zi, 0.0) for zi in z]]

    def slopes() -> list[Signal]:
        up = [v >= 0.0 for v in rows.smooth_velocity()]
        v = rows.velocity()
        return [
            [np.where(ui, vi, 0.0) for vi, ui in zip(v, up, strict=True)],
            [np.where(ui, 0.0, vi) for vi, ui in zip(v, up, strict=True)],
        ]

    def parameters(theta: Theta, c: Array) -> dict[str, float]:
        values = dict.fromkeys(SLOPES, 0.0) | dict(zip(LEVELS + SLOPES, c.tolist(), strict=False))
        return {**values, 'presliding': theta[0]}

    plain = Term(
        lambda theta: rows.columns(*levels(theta)),
        parameters,
        grid=tuple((g,) for g in presliding_grid(rows)),
        lower=(0.0,),
        upper=(longest_presliding(rows),),
        admissible=lambda theta, c: bool(
            np.min(c[:2]) > 0.0 and np.min(c[2:], initial=0.0) >= -rows.viscous
        ),
    )
    return replace(
        plain,
        richer=lambda: replace(
            plain, columns=lambda theta: rows.columns(*levels(theta), *slopes())
        ),
    )
