"""Frame of the tracker against that of the stage."""

from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='tracker_misalignment',
    link='sensor',
    parameters=(
        Parameter('angle', 'rad', -3.2, 3.2, 100e-6, 'rotation of the frame about z'),
        Parameter('offset_x', 'm', -50.0, 50.0, 0.0, 'offset along x', nuisance=True),
        Parameter('offset_y', 'm', -50.0, 50.0, 0.0, 'offset along y', nuisance=True),
    ),
    model='measured = R(+angle) * p + offset. Eq. 24 of paper 1 (rigid part).',
    sentence='the tracker frame is turned by {angle} against the stage',
    excited_by='lines along both axes',
    per_axis=False,
)
