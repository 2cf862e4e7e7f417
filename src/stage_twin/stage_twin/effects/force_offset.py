"""A constant force of the drive."""

from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='force_offset',
    link='servo',
    parameters=(
        Parameter('offset', 'N', -200.0, 200.0, 3.0, 'constant force on the moving mass'),
    ),
    model='Constant force of the drive: current sensor offset, inclined guide, tightened cover. '
    'Janot, Gautier, Brunot, EMPS (2019), offset term.',
    sentence='a constant force of {offset} acts on the moving mass',
    excited_by='strokes in both directions',
)
