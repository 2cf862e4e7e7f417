"""Coulomb friction with elastic pre-sliding."""

from __future__ import annotations

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
)
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term

EFFECT = Effect(
    name='coulomb_friction',
    link='servo',
    parameters=(friction_force('coulomb', 10.0, 'sliding force'), PRESLIDING, CREEP),
    model='Sliding force against the motion with elastic pre-sliding, '
    'dz/dt = v - |v| z / g, force = coulomb * z / g, g = presliding. '
    'Dahl, "A solid friction model", Aerospace Corporation TOR-158 (1968).',
    sentence='friction of {coulomb} opposes the motion at any speed',
    excited_by='reversals at several speeds',
)


def sliding(coulomb: float) -> float:
    """Level of the friction [N]."""
    return coulomb


def stiffness(coulomb: float, presliding: float) -> float:
    """Stiffness before sliding [N/m]."""
    return coulomb / max(presliding, SHORTEST_PRESLIDING)


creep, signature = gives_way, speed_curve


def term(rows: ForceRows) -> Term:
    """The direction, built up over the pre-sliding displacement (θ)."""
    return Term(
        lambda theta: rows.columns(bristles(rows, theta[0])),
        lambda theta, c: {'coulomb': float(c[0]), 'presliding': theta[0]},
        grid=tuple((g,) for g in presliding_grid(rows)),
        lower=(0.0,),
        upper=(longest_presliding(rows),),
        admissible=lambda theta, c: bool(c[0] > 0.0),
    )
