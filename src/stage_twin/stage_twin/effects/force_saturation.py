"""An amplifier that clips below the limit that the controller knows of."""

from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='force_saturation',
    link='servo',
    parameters=(
        Parameter(
            'limit', 'N', 0.0, 2000.0, 100.0, 'largest force that the amplifier gives; 0 is off'
        ),
    ),
    model='The amplifier clips below the `force_limit` that the controller knows of, so that its '
    'integral winds up. Astrom and Hagglund, "Advanced PID control" (2006), wind-up.',
    sentence='the drive gives no more than {limit}',
    excited_by='strokes at the highest acceleration',
    separated_from={
        'inertia_mismatch': 'the same stroke at two accelerations: saturation acts only on the '
        'fast one',
    },
)
