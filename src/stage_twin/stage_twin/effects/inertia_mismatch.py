"""A moving mass other than the nominal one."""

from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='inertia_mismatch',
    link='servo',
    parameters=(Parameter('ratio', '', -0.8, 3.0, 0.1, 'moving mass = mass * (1 + ratio)'),),
    model='A payload or a rotor that the nominal mass leaves out. Janot, Gautier, Brunot, EMPS '
    '(2019), inverse dynamic model.',
    sentence='the moving mass differs from the nominal one by {ratio} of it',
    excited_by='strokes at several accelerations',
    excludes=('drive_gain',),
)
