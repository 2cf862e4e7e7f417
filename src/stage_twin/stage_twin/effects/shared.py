"""What several effects have alike: parameters, the angle of a screw."""

from __future__ import annotations

import math

from numba import njit

from stage_twin.effects.definition import Parameter

PERIOD = Parameter(
    'period', 'm', 0.0, 20.0, 0.0, 'spatial period; 0 takes the lead', fitted=False, neutral=None
)
PHASE = Parameter(
    'phase', 'rad', -6.2831854, 6.2831854, 0.0, 'phase at position 0', nuisance=True, neutral=None
)
CENTRE = Parameter(
    'centre', 'm', -20.0, 20.0, 0.0, 'middle of the travel', fitted=False, neutral=None
)
HALF_RANGE = Parameter(
    'half_range',
    'm',
    1e-3,
    20.0,
    0.05,
    'half of the travel over which it is given',
    fitted=False,
    neutral=None,
)

#: Spatial periods below this [m] stand for the lead.
SHORTEST_LENGTH = 1e-9


@njit
def screw_angle(position: float, period: float, lead: float) -> float:
    """Angle [rad] of what repeats over `period`, or over the lead where that is 0."""
    return 2.0 * math.pi * position / (period if period > SHORTEST_LENGTH else lead)
