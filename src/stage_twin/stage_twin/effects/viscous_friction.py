"""Viscous friction beyond what the twin file says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.friction import speed_curve, viscous
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term, Theta, constant

EFFECT = Effect(
    name='viscous_friction',
    link='servo',
    parameters=(
        viscous('viscous', 20.0, "coefficient added to the file's `viscous`"),
        Parameter(
            'quadratic', 'N·s²/m²', -1e4, 1e4, 0.0, 'growth of the coefficient with the speed'
        ),
    ),
    model='Force -(viscous + quadratic * |v|) * v on the moving mass. Armstrong-Helouvry, '
    'Dupont, Canudas de Wit, '
    '"A survey of models, analysis tools and compensation methods for the control of machines '
    'with friction", Automatica 30 (1994).',
    sentence='friction grows with speed by {viscous} more than the twin says',
    excited_by='strokes at several constant speeds',
    scales=True,
)


def prepare(axis: dict[str, float], viscous: float) -> None:
    """The viscous coefficient [N·s/m]."""
    axis['viscous'] += viscous


def force(velocity: float, quadratic: float) -> float:
    """Force on the moving mass [N]."""
    return -quadratic * abs(velocity) * velocity


signature = speed_curve


def term(rows: ForceRows) -> Term:
    """The velocity, and in the richer shape its product with the speed."""
    signal = rows.columns(rows.velocity())
    fastest = max(float(np.abs(v).max()) for v in rows.smooth_velocity())

    def grows(theta: Theta, c: Array) -> bool:
        """Whether there is a friction at all speeds, one that does not fall."""
        return bool(min(c[0], c[0] + 2.0 * c[1] * fastest) >= -rows.viscous)

    def curved() -> Term:
        squares = rows.columns([v * np.abs(v) for v in rows.smooth_velocity()])
        return replace(
            plain,
            columns=constant(np.hstack([signal, squares])),
            parameters=lambda theta, c: {'viscous': float(c[0]), 'quadratic': float(c[1])},
            admissible=grows,
            richer=None,
        )

    plain = Term(
        constant(signal),
        lambda theta, c: {'viscous': float(c[0])},
        # Less than none at all is no friction.
        admissible=lambda theta, c: bool(c[0] >= -rows.viscous),
        richer=curved,
    )
    return plain
