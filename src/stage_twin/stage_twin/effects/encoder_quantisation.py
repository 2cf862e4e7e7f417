"""An encoder that counts in coarser steps than stated."""

from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='encoder_quantisation',
    link='sensor',
    parameters=(
        Parameter('resolution', 'm', 0.0, 1e-3, 5e-6, "takes the place of the file's resolution"),
    ),
    model='The encoder counts in steps coarser than stated. Widrow and Kollar, "Quantization '
    'noise" (2008).',
    sentence='the encoder counts in steps of {resolution}',
    excited_by='slow strokes',
)
