"""Parameters that several effects have alike."""

from stage_twin.effects.definition import Parameter

PRESLIDING = Parameter(
    'presliding',
    'm',
    0.0,
    20e-6,
    1e-6,
    'displacement over which the force builds up after a reversal (bristle deflection when it '
    'slides or breaks away); 0 is dry friction',
)
PERIOD = Parameter('period', 'm', 0.0, 0.2, 0.0, 'spatial period; 0 takes the lead', fitted=False)
PHASE = Parameter('phase', 'rad', -6.2831854, 6.2831854, 0.0, 'phase at position 0', nuisance=True)
CENTRE = Parameter('centre', 'm', -2.0, 2.0, 0.0, 'middle of the travel', fitted=False)
HALF_RANGE = Parameter(
    'half_range', 'm', 1e-3, 2.0, 0.05, 'half of the travel over which it is given', fitted=False
)


def friction_force(name: str, when_on: float, meaning: str) -> Parameter:
    """A level of friction [N]."""
    return Parameter(name, 'N', 0.0, 500.0, when_on, meaning)


def viscous(name: str, when_on: float, meaning: str) -> Parameter:
    """A viscous coefficient [N·s/m]."""
    return Parameter(name, 'N·s/m', -500.0, 2000.0, when_on, meaning)
