"""Wobble and eccentricity of the screw."""

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.shared import PERIOD, PHASE

EFFECT = Effect(
    name='cyclic_pitch_error',
    link='kinematic',
    parameters=(Parameter('amplitude', 'm', 0.0, 200e-6, 3e-6, 'amplitude'), PERIOD, PHASE),
    model='amplitude * sin(2 pi p / period + phase) along the axis: wobble and eccentricity of '
    'the screw. ISO 230-2:2014, intra-pitch deviation; Slocum, "Precision machine design" (1992).',
    sentence='the table swings by {amplitude} with each turn of the screw',
    excited_by='positions within several turns of the screw',
)
