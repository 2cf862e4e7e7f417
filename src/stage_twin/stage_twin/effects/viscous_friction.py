"""Viscous friction beyond what the twin file says."""

from stage_twin.effects.definition import Effect
from stage_twin.effects.shared import viscous

EFFECT = Effect(
    name='viscous_friction',
    link='servo',
    parameters=(viscous('viscous', 20.0, "coefficient added to the file's `viscous`"),),
    model='Force -viscous * v on the moving mass. Armstrong-Helouvry, Dupont, Canudas de Wit, '
    '"A survey of models, analysis tools and compensation methods for the control of machines '
    'with friction", Automatica 30 (1994).',
    sentence='friction grows with speed by {viscous} more than the twin says',
    excited_by='strokes at several constant speeds',
)
