"""A controller whose gains, filter or feed-forward are not the twin's."""

from stage_twin.effects.definition import Effect, Parameter


def _relative(name: str, what: str) -> Parameter:
    return Parameter(f'{name}_error', '', -0.95, 20.0, 0.0, f'relative error of {what}')


EFFECT = Effect(
    name='controller_mismatch',
    link='servo',
    parameters=(
        _relative('position_gain', 'the position gain'),
        Parameter(
            'velocity_feedforward_error',
            '',
            -2.0,
            2.0,
            0.0,
            'velocity feed-forward of the machine less that of the twin file',
        ),
        _relative('velocity_gain', 'the velocity gain'),
        _relative('integral_gain', 'the integral gain'),
        _relative('velocity_filter', 'the corner of the velocity filter'),
    ),
    model='The law of interfaces.md, "Servo controller", with gain * (1 + error). Ljung, '
    '"System identification" (1999), direct identification of a known regulator structure.',
    sentence='the controller is not the one of the twin: position gain {position_gain_error}, '
    'velocity gain {velocity_gain_error}, integral gain {integral_gain_error}, velocity filter '
    '{velocity_filter_error} off, feed-forward {velocity_feedforward_error} more',
    excited_by='any motion, with the velocity command and the force recorded',
    needs_effort='the gains are fitted to the session',
)


def prepare(
    axis: dict[str, float],
    position_gain_error: float,
    velocity_feedforward_error: float,
    velocity_gain_error: float,
    integral_gain_error: float,
    velocity_filter_error: float,
) -> None:
    """Gains of the controller."""
    axis['position_gain'] *= 1.0 + position_gain_error
    axis['velocity_gain'] *= 1.0 + velocity_gain_error
    axis['integral_gain'] *= 1.0 + integral_gain_error
    axis['velocity_filter'] *= 1.0 + velocity_filter_error
    axis['velocity_feedforward'] += velocity_feedforward_error
