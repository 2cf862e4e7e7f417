"""Force over position with a period: cogging and commutation."""

from __future__ import annotations

import numpy as np

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.shared import PERIOD, PHASE
from stage_twin.effects.term import Term, constant

EFFECT = Effect(
    name='force_ripple',
    link='servo',
    parameters=(Parameter('amplitude', 'N', 0.0, 100.0, 2.0, 'amplitude'), PERIOD, PHASE),
    model='Force amplitude * sin(2 pi p / period + phase) on the moving mass: cogging and '
    'commutation. Jahns and Soong, "Pulsating torque minimization techniques for permanent '
    'magnet AC motor drives", IEEE Trans. Industrial Electronics 43 (1996).',
    sentence='the drive force ripples over position by {amplitude}',
    excited_by='slow strokes over whole periods of the motor',
)


def term(rows: ForceRows) -> Term:
    """Sine and cosine over the lead."""
    angles = [2.0 * np.pi * p / rows.lead for p in rows.position()]
    signal = rows.columns([-np.sin(a) for a in angles], [-np.cos(a) for a in angles])
    return Term(
        constant(signal),
        lambda theta, c: {
            'amplitude': float(np.hypot(c[0], c[1])),
            'phase': float(np.arctan2(c[1], c[0])),
        },
        admissible=lambda theta, c: float(np.hypot(c[0], c[1])) < 100.0,
        nuisances=(0, 1),
        phase=True,
    )
