"""An error of the force constant."""

from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='drive_gain',
    link='servo',
    parameters=(Parameter('error', '', -0.8, 1.0, 0.05, 'acting force = (1 + error) * F'),),
    model='Error of the force constant (N per ampere, N per volt). Gautier and Briot, "Global '
    'identification of joint drive gains and dynamic parameters of robots", ASME JDSMC 136 '
    '(2014).',
    sentence='the drive gives {error} more force than it is asked for',
    excited_by='strokes at several accelerations and speeds',
    separated_from={
        'inertia_mismatch': 'a known mass on the table, or strokes at constant high speed: '
        'viscous friction does not depend on the mass',
    },
    excludes=('inertia_mismatch',),
    merges=('inertia_mismatch', 'viscous_friction'),
)
