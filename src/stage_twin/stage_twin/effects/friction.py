"""Friction of guide and screw: viscous, Coulomb with pre-sliding, asymmetric, Stribeck."""

from stage_twin.effects.definition import Effect, EffectParameter

PRESLIDING = EffectParameter(
    'presliding',
    'm',
    0.0,
    20e-6,
    1e-6,
    'displacement over which the force builds up after a reversal (bristle deflection when it '
    'slides or breaks away); 0 is dry friction',
)


def _force(name: str, value: float, description: str) -> EffectParameter:
    return EffectParameter(name, 'N', 0.0, 500.0, value, description)


def _viscous(name: str, value: float, description: str) -> EffectParameter:
    return EffectParameter(name, 'N·s/m', -500.0, 2000.0, value, description)


VISCOUS_FRICTION = Effect(
    'viscous_friction',
    'servo',
    True,
    (_viscous('viscous', 20.0, "coefficient added to the file's `viscous`"),),
    'Force -viscous * v on the moving mass. Armstrong-Helouvry, Dupont, Canudas de Wit, '
    '"A survey of models, analysis tools and compensation methods for the control of machines '
    'with friction", Automatica 30 (1994).',
)

COULOMB_FRICTION = Effect(
    'coulomb_friction',
    'servo',
    True,
    (_force('coulomb', 10.0, 'sliding force'), PRESLIDING),
    'Sliding force against the motion with elastic pre-sliding, '
    'dz/dt = v - |v| z / g, force = coulomb * z / g, g = presliding. '
    'Dahl, "A solid friction model", Aerospace Corporation TOR-158 (1968).',
)

ASYMMETRIC_FRICTION = Effect(
    'asymmetric_friction',
    'servo',
    True,
    (
        _force('coulomb_positive', 12.0, 'sliding force for v > 0'),
        _force('coulomb_negative', 8.0, 'sliding force for v < 0'),
        _viscous('viscous_positive', 0.0, 'added viscous coefficient, v > 0'),
        _viscous('viscous_negative', 0.0, 'added viscous coefficient, v < 0'),
        PRESLIDING,
    ),
    'Friction with a level and a slope of its own in each direction; it holds its Coulomb part '
    'and adds to what else is on. Janot, Gautier, Brunot, "Data set and reference models of '
    'EMPS", Workshop on Nonlinear System Identification Benchmarks (2019), asymmetric model.',
)

STRIBECK_FRICTION = Effect(
    'stribeck_friction',
    'servo',
    True,
    (
        _force('coulomb', 10.0, 'sliding force at high speed'),
        _force('breakaway', 6.0, 'excess of the force near standstill'),
        EffectParameter(
            'stribeck_velocity', 'm/s', 1e-4, 0.2, 5e-3, 'speed at which the excess has decayed'
        ),
        PRESLIDING,
    ),
    'LuGre friction with sliding force coulomb + breakaway * exp(-(v / stribeck_velocity)^2). '
    'Canudas de Wit, Olsson, Astrom, Lischinsky, "A new model for control of systems with '
    'friction", IEEE TAC 40 (1995); eqs. 6-7 of paper 3.',
)

FRICTION_EFFECTS = (VISCOUS_FRICTION, COULOMB_FRICTION, ASYMMETRIC_FRICTION, STRIBECK_FRICTION)
