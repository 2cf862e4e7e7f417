"""Coulomb friction with elastic pre-sliding."""

from stage_twin.effects.definition import Effect
from stage_twin.effects.shared import PRESLIDING, friction_force

EFFECT = Effect(
    name='coulomb_friction',
    link='servo',
    parameters=(friction_force('coulomb', 10.0, 'sliding force'), PRESLIDING),
    model='Sliding force against the motion with elastic pre-sliding, '
    'dz/dt = v - |v| z / g, force = coulomb * z / g, g = presliding. '
    'Dahl, "A solid friction model", Aerospace Corporation TOR-158 (1968).',
    sentence='friction of {coulomb} opposes the motion at any speed',
    excited_by='reversals at several speeds',
)
