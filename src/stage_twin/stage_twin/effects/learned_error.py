"""A law of the position error that the named effects leave, as the diagnosis learned it."""

from __future__ import annotations

from stage_core.arrays import Array
from stage_twin.effects import law_terms
from stage_twin.effects.definition import Effect

VARIABLES = ('1', 'p', 'v', 's', 't', 'q', 'T')

EFFECT = Effect(
    name='learned_error',
    link='kinematic',
    parameters=law_terms.parameters('m', 1e-3, VARIABLES),
    model='Sum of terms size * shape(first) * shape(second) along the axis, each behind a memory. '
    'Brunton, Proctor, Kutz, "Discovering governing equations from data by sparse '
    'identification of nonlinear dynamical systems", PNAS 113 (2016).',
    sentence='an error that no effect names moves the table: by {size0} in its largest term',
    excited_by='strokes of both axes over the whole travel, in both directions',
    states=(*law_terms.STATES, 'position'),
    order=20,
)


def start(state: Array, position: float) -> None:
    """No direction yet."""
    state[-1] = position


def follow(
    position: float, velocity: float, step: float, time: float, state: Array, parameters: Array
) -> float:
    """Position of the table by what goes with the axis itself [m]."""
    travelled = position - state[-1]
    state[-1] = position
    x = (1.0, position, velocity, 0.0, 0.0, time, 0.0, 0.0, 0.0, 0.0)
    return position + law_terms.total(x, 0, state, travelled, step, parameters)


def turn(position: float, other: float, parameters: Array) -> float:
    """Displacement along by what goes with the place of the other axis [m], without a state."""
    x = (1.0, position, 0.0, 0.0, 0.0, 0.0, other, 0.0, 0.0, 0.0)
    return law_terms.stateless(x, 1, parameters)


def along(motor: float, rise: float, parameters: Array) -> float:
    """Displacement along by what goes with the temperature [m], without a state."""
    x = (1.0, motor, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, rise)
    return law_terms.stateless(x, 2, parameters)
