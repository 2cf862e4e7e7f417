"""The recorded effort is no force in newtons: another sign, another unit, or no sign at all."""

from __future__ import annotations

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='effort_convention',
    link='sensor',
    parameters=(
        Parameter('factor', '', -1e6, 1e6, -1.0, 'recorded effort over force', neutral=1.0),
        Parameter('magnitude', '', 0.0, 1.0, 0.0, '1 where the record holds no sign'),
    ),
    model='recorded effort = factor * F, or its magnitude. Ljung, "System identification" (1999), '
    'scaling of signals.',
    sentence='the recorded effort is {factor} of the force in newtons',
    excited_by='any motion, with the force recorded',
    needs_effort='no effort is recorded',
)


def recorded(force: Array, factor: float, magnitude: float) -> Array:
    """Effort (n,) as it is recorded, of a force (n,) [N]."""
    return factor * (np.abs(force) if magnitude > 0.5 else force)
