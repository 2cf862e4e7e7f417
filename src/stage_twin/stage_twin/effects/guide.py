"""Geometry of the guides: squareness, straightness, yaw."""

from stage_twin.effects.definition import Effect, EffectParameter

CENTRE = EffectParameter('centre', 'm', -2.0, 2.0, 0.0, 'middle of the travel', fitted=False)
HALF_RANGE = EffectParameter(
    'half_range', 'm', 1e-3, 2.0, 0.05, 'half of the travel over which it is given', fitted=False
)

NONORTHOGONALITY = Effect(
    'nonorthogonality',
    'kinematic',
    False,
    (
        EffectParameter(
            'angle', 'rad', -0.05, 0.05, 80e-6, 'x_t = x - sin(angle) * y, y_t = cos(angle) * y'
        ),
    ),
    'Squareness error of two stacked axes. ISO 230-1:2012; paper 1, section 2.',
)

STRAIGHTNESS = Effect(
    'straightness',
    'kinematic',
    True,
    (
        EffectParameter('quadratic', 'm', -1e-3, 1e-3, 4e-6, 'bow: factor of P2(s)'),
        EffectParameter('cubic', 'm', -1e-3, 1e-3, 0.0, 'S shape: factor of P3(s)'),
        CENTRE,
        HALF_RANGE,
    ),
    'Displaces the other axis by quadratic * P2(s) + cubic * P3(s), s = (p - centre) / '
    'half_range; Legendre polynomials are orthogonal to a line, so that the least-squares '
    'reference line is removed. ISO 230-1:2012; ISO/TR 16907:2015.',
)

ANGULAR_ERROR = Effect(
    'angular_error',
    'kinematic',
    True,
    (
        EffectParameter('linear', 'rad', -5e-3, 5e-3, 40e-6, 'yaw at the end of the travel'),
        EffectParameter('quadratic', 'rad', -5e-3, 5e-3, 0.0, 'factor of P2(s) in the yaw'),
        EffectParameter(
            'arm', 'm', -1.0, 1.0, 0.05, 'Abbe arm from the guide to the point measured'
        ),
        CENTRE,
        HALF_RANGE,
    ),
    'Yaw of the carriage, linear * s + quadratic * P2(s), s = (p - centre) / half_range, moves '
    'the point along its axis by yaw times the arm plus the other coordinate: for x '
    '-yaw * (y + arm), for y +yaw * (x + arm). Bryan, "The Abbe principle revisited", Precision '
    'Engineering 1 (1979); paper 1, section 2.',
)

GUIDE_EFFECTS = (NONORTHOGONALITY, STRAIGHTNESS, ANGULAR_ERROR)
