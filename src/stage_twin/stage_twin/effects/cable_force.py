"""The cable chain as a spring."""

from __future__ import annotations

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term, Theta

#: Share of what hardening adds at an end by which noise may make a stiffness negative inside.
SOFT = 0.05

EFFECT = Effect(
    name='cable_force',
    link='servo',
    parameters=(
        Parameter('stiffness', 'N/m', 0.0, 1e6, 100.0, 'restoring force per displacement'),
        Parameter('centre', 'm', -1.0, 1.0, 0.0, 'position without cable force', neutral=None),
        Parameter(
            'hardening',
            'N/m³',
            -1e9,
            1e9,
            0.0,
            'growth of stiffness with displacement squared',
        ),
    ),
    model='Force -(stiffness * s + hardening * s^3), s = p - centre: the cable chain as a spring. '
    'Altintas et al., "Machine tool feed drives", CIRP Annals 60 (2011), disturbance forces.',
    sentence='a spring of {stiffness} pulls the axis back, as a cable chain does',
    excited_by='slow strokes over the whole travel',
    holds=('force_offset',),
    along_travel=True,
)


def force(position: float, stiffness: float, centre: float, hardening: float) -> float:
    """Force on the moving mass [N]."""
    stretch = position - centre
    return -(stiffness + hardening * stretch * stretch) * stretch


def term(rows: ForceRows) -> Term:
    """Displacement and its cube; θ is the centre in half travels from the travel's middle."""
    path = rows.used(rows.position())
    middle, half = 0.5 * float(path.max() + path.min()), max(0.5 * float(np.ptp(path)), 1e-9)

    def columns(theta: Theta) -> Array:
        s = [p - middle - theta[0] * half for p in rows.position()]
        return rows.columns(s, [si * si * si for si in s])

    def stiffens(theta: Theta, c: Array) -> bool:
        """Whether the spring pulls back over the whole travel."""
        hardest = c[1] * (np.array([-1.0, 1.0]) * half - theta[0] * half) ** 2
        return bool(c[0] > -SOFT * hardest.max() and np.all(c[0] + 3.0 * hardest > 0.0))

    return Term(
        columns,
        lambda theta, c: {
            'stiffness': max(float(c[0]), 0.0),
            'hardening': float(c[1]),
            'centre': middle + theta[0] * half,
        },
        grid=tuple((c,) for c in (0.0, -0.5, 0.5, -1.0, 1.0, -2.0, 2.0, -6.0, 6.0)),
        lower=(-10.0,),
        upper=(10.0,),
        admissible=stiffens,
    )
