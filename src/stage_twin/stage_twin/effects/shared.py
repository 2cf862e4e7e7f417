"""Parameters that several effects have alike."""

from stage_twin.effects.definition import Parameter

PERIOD = Parameter('period', 'm', 0.0, 0.2, 0.0, 'spatial period; 0 takes the lead', fitted=False)
PHASE = Parameter('phase', 'rad', -6.2831854, 6.2831854, 0.0, 'phase at position 0', nuisance=True)
CENTRE = Parameter('centre', 'm', -2.0, 2.0, 0.0, 'middle of the travel', fitted=False)
HALF_RANGE = Parameter(
    'half_range', 'm', 1e-3, 2.0, 0.05, 'half of the travel over which it is given', fitted=False
)
