"""Viscous friction beyond what the twin file says."""

from __future__ import annotations

from stage_twin.effects.definition import Effect
from stage_twin.effects.friction import speed_curve, viscous
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term, constant

EFFECT = Effect(
    name='viscous_friction',
    link='servo',
    parameters=(viscous('viscous', 20.0, "coefficient added to the file's `viscous`"),),
    model='Force -viscous * v on the moving mass. Armstrong-Helouvry, Dupont, Canudas de Wit, '
    '"A survey of models, analysis tools and compensation methods for the control of machines '
    'with friction", Automatica 30 (1994).',
    sentence='friction grows with speed by {viscous} more than the twin says',
    excited_by='strokes at several constant speeds',
)


def prepare(axis: dict[str, float], viscous: float) -> None:
    """The viscous coefficient [N·s/m]."""
    axis['viscous'] += viscous


signature = speed_curve


def term(rows: ForceRows) -> Term:
    """The velocity."""
    signal = rows.columns(rows.velocity())
    return Term(
        constant(signal),
        lambda theta, c: {'viscous': float(c[0])},
        # Less than none at all is no friction.
        admissible=lambda theta, c: -rows.viscous <= c[0] < 2000.0,
    )
