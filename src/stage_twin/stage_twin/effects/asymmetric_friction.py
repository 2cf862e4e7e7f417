"""Friction with a level and a slope of its own in each direction."""

from __future__ import annotations

from stage_twin.effects.definition import Effect
from stage_twin.effects.friction import (
    PRESLIDING,
    SHORTEST_PRESLIDING,
    bristles,
    friction_force,
    longest_presliding,
    presliding_grid,
    speed_curve,
    viscous,
)
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Array, Term, Theta

EFFECT = Effect(
    name='asymmetric_friction',
    link='servo',
    parameters=(
        friction_force('coulomb_positive', 12.0, 'sliding force for v > 0'),
        friction_force('coulomb_negative', 8.0, 'sliding force for v < 0'),
        viscous('viscous_positive', 0.0, 'added viscous coefficient, v > 0'),
        viscous('viscous_negative', 0.0, 'added viscous coefficient, v < 0'),
        PRESLIDING,
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
    differ=(('coulomb_positive', 'coulomb_negative'), ('viscous_positive', 'viscous_negative')),
    excludes=('position_dependent_friction', 'stribeck_friction'),
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


signature = speed_curve


def term(rows: ForceRows) -> Term:
    """Direction and velocity, each for both directions; θ is the pre-sliding displacement."""

    def columns(theta: Theta) -> Array:
        z = bristles(rows, theta[0])
        up = [(v >= 0.0).astype(float) for v in rows.smooth_velocity()]
        v = rows.velocity()
        return rows.columns(
            [zi * ui for zi, ui in zip(z, up, strict=True)],
            [zi * (1.0 - ui) for zi, ui in zip(z, up, strict=True)],
            [vi * ui for vi, ui in zip(v, up, strict=True)],
            [vi * (1.0 - ui) for vi, ui in zip(v, up, strict=True)],
        )

    return Term(
        columns,
        lambda theta, c: {
            'coulomb_positive': float(c[0]),
            'coulomb_negative': float(c[1]),
            'viscous_positive': float(c[2]),
            'viscous_negative': float(c[3]),
            'presliding': theta[0],
        },
        grid=tuple((g,) for g in presliding_grid(rows)),
        lower=(0.0,),
        upper=(longest_presliding(rows),),
        admissible=lambda theta, c: bool(
            min(c[0], c[1]) > 0.0 and min(c[2], c[3]) >= -rows.viscous
        ),
    )
