"""Force over position with a period: cogging and commutation."""

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.shared import PERIOD, PHASE

EFFECT = Effect(
    name='force_ripple',
    link='servo',
    parameters=(Parameter('amplitude', 'N', 0.0, 100.0, 2.0, 'amplitude'), PERIOD, PHASE),
    model='Force amplitude * sin(2 pi p / period + phase) on the moving mass: cogging and '
    'commutation. Jahns and Soong, "Pulsating torque minimization techniques for permanent '
    'magnet AC motor drives", IEEE Trans. Industrial Electronics 43 (1996).',
    sentence='the drive force ripples over position by {amplitude}',
    excited_by='slow strokes over whole periods of the motor',
)
