"""Play between motor and table."""

from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='backlash',
    link='kinematic',
    parameters=(Parameter('width', 'm', 0.0, 1e-3, 10e-6, 'full width of the play'),),
    model='Play operator between motor and table, centred at the start of a session. Nordin and '
    'Gutman, "Controlling mechanical systems with backlash: a survey", Automatica 38 (2002).',
    sentence='the table follows the motor late by {width} after each reversal',
    excited_by='the same positions approached from both sides',
    separated_from={
        'cyclic_pitch_error': 'the same positions approached from both sides: play changes sign '
        'with the direction, a pitch error does not',
    },
)
