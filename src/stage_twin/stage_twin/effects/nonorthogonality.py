"""Squareness error of two stacked axes."""

from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='nonorthogonality',
    link='kinematic',
    parameters=(
        Parameter(
            'angle', 'rad', -0.05, 0.05, 80e-6, 'x_t = x - sin(angle) * y, y_t = cos(angle) * y'
        ),
    ),
    model='Squareness error of two stacked axes. ISO 230-1:2012; paper 1, section 2.',
    sentence='the axes are out of square by {angle}',
    excited_by='lines along both axes',
    per_axis=False,
    separated_from={
        'tracker_misalignment': 'lines along both axes: squareness turns only one of them in the '
        'tracker frame',
    },
)
