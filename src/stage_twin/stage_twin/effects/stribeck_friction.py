"""Stribeck friction: the sliding force falls with speed near standstill (LuGre)."""

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.shared import PRESLIDING, friction_force

EFFECT = Effect(
    name='stribeck_friction',
    link='servo',
    parameters=(
        friction_force('coulomb', 10.0, 'sliding force at high speed'),
        friction_force('breakaway', 6.0, 'excess of the force near standstill'),
        Parameter(
            'stribeck_velocity', 'm/s', 1e-4, 0.2, 5e-3, 'speed at which the excess has decayed'
        ),
        PRESLIDING,
    ),
    model='LuGre friction with sliding force coulomb + breakaway * exp(-(v / stribeck_velocity)^2)'
    '. Canudas de Wit, Olsson, Astrom, Lischinsky, "A new model for control of systems with '
    'friction", IEEE TAC 40 (1995); eqs. 6-7 of paper 3.',
    sentence='friction of {coulomb} rises by {breakaway} below {stribeck_velocity}',
    excited_by='constant-speed strokes from 0.1 to 20 mm/s',
    separated_from={
        'coulomb_friction': 'constant-speed strokes from 0.1 to 20 mm/s: only Stribeck friction '
        'falls with speed',
    },
    holds=('coulomb_friction',),
)
