"""The other axis' motion pulls on this one."""

from __future__ import annotations

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term, constant

EFFECT = Effect(
    name='axis_crosstalk',
    link='servo',
    parameters=(
        Parameter(
            'mass', 'kg', -500.0, 500.0, 1.0, "mass that the other axis' acceleration moves"
        ),
        Parameter('viscous', 'N·s/m', -2e4, 2e4, 0.0, "force against the other axis' velocity"),
    ),
    model='Force -(mass * a_other + viscous * v_other) on the moving mass: axes that are not '
    'square to each other, or whose centre of mass lies off the guide, share their inertia. '
    'Altintas et al., "Machine tool feed drives", CIRP Annals 60 (2011).',
    sentence='the other axis pulls with {mass} times its acceleration and {viscous} times its '
    'velocity',
    excited_by='strokes of one axis while the other one moves slowly',
)


def force(other_velocity: float, other_acceleration: float, mass: float, viscous: float) -> float:
    """Force on the moving mass [N]."""
    return -(mass * other_acceleration + viscous * other_velocity)


def term(rows: ForceRows) -> Term | None:
    """Acceleration and velocity of the other axis."""
    acceleration, velocity = rows.other_acceleration(), rows.other_velocity()
    if acceleration is None or velocity is None:
        return None
    columns = rows.columns(acceleration, velocity)
    slope = [np.gradient(f, t) for f, t in zip(rows.applied(), rows.periods, strict=True)]
    return Term(
        constant(columns),
        lambda theta, c: {'mass': float(c[0]), 'viscous': float(c[1])},
        follows=_likeness(columns, rows.columns(rows.applied(), slope)),
    )


def _likeness(one: Array, other: Array) -> float:
    """Largest squared correlation of what two sets of columns (n, k) span (Hotelling 1936)."""
    first, second = (
        np.linalg.qr(c / (np.linalg.norm(c, axis=0) + 1e-300))[0] for c in (one, other)
    )
    return min(float(np.linalg.norm(first.T @ second, 2)) ** 2, 1.0)
