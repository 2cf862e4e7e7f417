"""Friction with a level and a slope of its own in each direction."""

from stage_twin.effects.definition import Effect
from stage_twin.effects.shared import PRESLIDING, friction_force, viscous

EFFECT = Effect(
    name='asymmetric_friction',
    link='servo',
    parameters=(
        friction_force('coulomb_positive', 12.0, 'sliding force for v > 0'),
        friction_force('coulomb_negative', 8.0, 'sliding force for v < 0'),
        viscous('viscous_positive', 0.0, 'added viscous coefficient, v > 0'),
        viscous('viscous_negative', 0.0, 'added viscous coefficient, v < 0'),
        PRESLIDING,
    ),
    model='Friction with a level and a slope of its own in each direction; it holds its Coulomb '
    'part and adds to what else is on. Janot, Gautier, Brunot, "Data set and reference models of '
    'EMPS", Workshop on Nonlinear System Identification Benchmarks (2019), asymmetric model.',
    sentence='friction differs between the directions: {coulomb_positive} forwards, '
    '{coulomb_negative} backwards',
    excited_by='strokes in both directions at several speeds',
    separated_from={
        'coulomb_friction': 'strokes of equal speed in both directions with the force averaged '
        'over whole screw turns',
        'force_offset': 'reversals within a few micrometres: an offset stays constant while '
        'friction builds up',
    },
    holds=('coulomb_friction', 'viscous_friction', 'force_offset'),
)
