"""An encoder that counts in coarser steps than stated."""

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.shared import SHORTEST_LENGTH

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


def prepare(axis: dict[str, float], resolution: float) -> None:
    """The encoder's step [m]."""
    if resolution > SHORTEST_LENGTH:
        axis['encoder_resolution'] = resolution
