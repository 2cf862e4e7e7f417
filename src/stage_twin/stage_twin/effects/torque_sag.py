"""The force constant falls with force and with speed."""

from __future__ import annotations

import math

import numpy as np

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Array, Term, Theta

#: Least share of the force constant that is left, however strong the force.
LEAST = 0.2

EFFECT = Effect(
    name='torque_sag',
    link='servo',
    parameters=(
        Parameter('sag_force', '1/N', 0.0, 0.1, 5e-4, 'share of the force lost per force'),
        Parameter('sag_speed', 's/m', 0.0, 10.0, 0.0, 'share of the force lost per speed'),
    ),
    model='Acting force F * (1 - sag_force |F| - sag_speed |v|), at least 0.2 F: iron that '
    'saturates, and a voltage that the counter-voltage takes up. Krishnan, "Electric motor '
    'drives" (2001).',
    sentence='the drive gives less force than it is asked for, by {sag_force} and by {sag_speed}',
    excited_by='strokes at several accelerations and speeds',
    order=1,
)


def drive(force: float, velocity: float, sag_force: float, sag_speed: float) -> float:
    """Force that the motor gives [N]."""
    return force * max(LEAST, 1.0 - sag_force * abs(force) - sag_speed * abs(velocity))


def command(force: Array, velocity: Array, sag_force: float, sag_speed: float) -> Array:
    """Force to command for a force that acts, (n,) [N]."""
    wanted, whole = np.abs(force), 1.0 - sag_speed * np.abs(velocity)
    # c (whole - sag_force c) = wanted, the smaller root; no command beyond the least share.
    inside = np.maximum(whole * whole - 4.0 * sag_force * wanted, 0.0)
    root = 2.0 * wanted / np.maximum(whole + np.sqrt(inside), 1e-9)
    return np.sign(force) * np.minimum(root, wanted / LEAST)


def term(rows: ForceRows) -> Term | None:
    """The force times its own size and times the speed; θ is the angle between both shares."""
    force, speed = rows.applied(), [np.abs(v) for v in rows.smooth_velocity()]
    strongest = max(float(np.abs(f).max()) for f in force)
    fastest = max(float(v.max()) for v in speed)
    if strongest <= 0.0 or fastest <= 0.0:
        return None
    parts = rows.columns(
        [f * np.abs(f) / strongest for f in force],
        [f * v / fastest for f, v in zip(force, speed, strict=True)],
    )

    def weights(theta: Theta) -> Array:
        return np.array([math.cos(theta[0]), math.sin(theta[0])])

    def parameters(theta: Theta, c: Array) -> dict[str, float]:
        by_force, by_speed = weights(theta) * float(c[0])
        return {'sag_force': by_force / strongest, 'sag_speed': by_speed / fastest}

    return Term(
        lambda theta: (parts @ weights(theta))[:, None],
        parameters,
        grid=((0.0,), (0.25 * math.pi,), (0.5 * math.pi,)),
        lower=(0.0,),
        upper=(0.5 * math.pi,),
        admissible=lambda theta, c: bool(0.0 < c[0] < 1.0 - LEAST),
    )
