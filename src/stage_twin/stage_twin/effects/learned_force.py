"""A law of the force that the named effects leave, as the diagnosis learned it from a session."""

from __future__ import annotations

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects import law_terms
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.friction import SHORTEST_PRESLIDING

VARIABLES = ('1', 'p', 'v', 's', 'F', 't', 'u', 'w')

EFFECT = Effect(
    name='learned_force',
    link='servo',
    parameters=(
        Parameter('mass', 'kg', -50.0, 200.0, 0.0, 'force per acceleration, against it'),
        *law_terms.parameters('N', 5000.0, VARIABLES),
    ),
    model='Sum of terms size * shape(first) * shape(second) on the moving mass, each behind a '
    'memory; the direction of the motion makes a friction as `coulomb_friction`. Brunton, '
    'Proctor, Kutz, "Discovering governing equations from data by sparse identification of '
    'nonlinear dynamical systems", PNAS 113 (2016).',
    sentence='a force that no effect names pulls the axis: {size0} in its largest term',
    excited_by='strokes at several speeds and places, in both directions',
    states=law_terms.STATES,
    order=20,
)


def prepare(axis: dict[str, float], mass: float) -> None:
    """The moving mass [kg]."""
    axis['mass'] = max(axis['mass'] + mass, 0.2 * axis['mass'])


def force(
    position: float,
    velocity: float,
    acting: float,
    step: float,
    time: float,
    other_velocity: float,
    other_acceleration: float,
    state: Array,
    parameters: Array,
) -> float:
    """Force on the moving mass [N]; the first parameter is the mass."""
    x = (1.0, position, velocity, 0.0, acting, time, 0.0, other_velocity, other_acceleration)
    return law_terms.total(x, -1, state, velocity * step, step, parameters[1:])


def sliding(position: float, velocity: float, parameters: Array) -> float:
    """Level of the friction that the law holds [N]."""
    x = (1.0, position, velocity, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return max(law_terms.level(x, parameters[1:]), 0.0)


def stiffness(parameters: Array) -> float:
    """Stiffness before sliding [N/m] of the terms that brake, at their largest level."""
    count, end = law_terms.TERMS, law_terms.KNOT
    total = 0.0
    for term in (parameters[1:][i:end:count] for i in range(count)):
        size = -term[law_terms.SIZE]
        if term[law_terms.SHAPE] == law_terms.CURVE:  # a map, whose knots hold the force
            size = abs(size) * float(np.max(np.abs(parameters[1:][end:])))
        elif term[law_terms.FIRST] * term[law_terms.SECOND] > 0.0:  # its sign goes with the place
            size = abs(size)
        if law_terms.rubs(term):
            total += size / max(term[law_terms.REACH], SHORTEST_PRESLIDING)
    return max(total, 0.0)
