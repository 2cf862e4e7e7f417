"""An amplifier that clips below the limit that the controller knows of."""

from __future__ import annotations

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term, Theta

#: Least correlation of the clipped force with the acceleration where it clips most of the time:
#: 0.92 and more with an amplifier that clips 97 % of the ticks, 0.63 at most on seven development
#: sessions without one.
MOVES = 0.8
#: Least size of that force as a share of what accelerates the nominal mass: 1.04 to 1.37 at six
#: limits that clip 90 % of the ticks and more, 0.07 where a gain of twice stood beside a false
#: one. A machine may have less mass than the nominal one.
ENOUGH = 0.3
#: Amplifiers clip with a soft knee: of three right limits of foreign simulators two missed by 1.4
#: and 1.7 %.
DOUBT = 0.01

EFFECT = Effect(
    name='force_saturation',
    link='servo',
    parameters=(
        Parameter(
            'limit',
            'N',
            0.0,
            2e4,
            100.0,
            'largest force that the amplifier gives; 0 is off',
            doubt=DOUBT,
        ),
        Parameter(
            'known',
            '',
            0.0,
            1.0,
            0.0,
            '1 where the controller itself is limited to it, so that its integral is held',
            fitted=False,
            neutral=None,
        ),
    ),
    model='The amplifier clips below the `force_limit` that the controller knows of, so that its '
    'integral winds up, or the controller itself is limited to less than its `force_limit`. '
    'Astrom and Hagglund, "Advanced PID control" (2006), wind-up.',
    sentence='the drive gives no more than {limit}',
    excited_by='strokes at the highest acceleration',
    exact=True,
)


def prepare(axis: dict[str, float], limit: float, known: float) -> None:
    """Limit of a controller that is limited itself [N]."""
    if known > 0.5 and limit > 0.0:
        axis['force_limit'] = min(axis['force_limit'], limit)


def drive(force: float, limit: float) -> float:
    """Force that the amplifier gives [N]."""
    return min(max(force, -limit), limit) if limit > 0.0 else force


def command(force: Array, limit: float) -> Array:
    """Force to command for a force that acts, (n,) [N]."""
    return np.clip(force, -limit, limit)


def term(rows: ForceRows) -> Term | None:
    """The force less the same force clipped at a share (θ) of its peak."""
    peak = max(float(np.abs(f).max()) for f in rows.commanded())
    if rows.measured_force or peak <= 0.0:
        return None
    direct = rows.applied()
    strength = np.abs(rows.used(rows.commanded()))
    pushed = rows.columns(rows.acceleration())[:, 0]

    def columns(theta: Theta) -> Array:
        clipped = rows.applied(limit=theta[0] * peak)
        return rows.columns([f - g for f, g in zip(direct, clipped, strict=True)])

    def real(theta: Theta) -> bool:
        """Whether it clips now and then, or what it leaves is what accelerates the mass."""
        if np.mean(strength > theta[0] * peak) < 0.5:
            return True
        left = rows.columns(rows.applied(limit=theta[0] * peak))[:, 0]
        size, needed = float(np.linalg.norm(left)), float(np.linalg.norm(pushed))
        together = float(left @ pushed) / (size * needed)
        return together > MOVES and size > ENOUGH * rows.mass * needed

    return Term(
        columns,
        lambda theta, c: {'limit': theta[0] * peak},
        grid=tuple((s,) for s in (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)),
        lower=(0.002,),
        upper=(1.0,),
        # With no force at all the equation of motion has the trivial solution 0 = 0.
        admissible=lambda theta, c: real(theta),
        fixed=True,
    )
