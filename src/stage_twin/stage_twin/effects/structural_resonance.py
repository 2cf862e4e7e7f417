"""A share of the moving mass hangs on a spring behind the motor."""

from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='structural_resonance',
    link='servo',
    parameters=(
        Parameter(
            'frequency',
            'Hz',
            0.0,
            400.0,
            60.0,
            'natural frequency of the carried mass with the motor held; 0 is off',
        ),
        Parameter('damping', '', 0.0, 1.0, 0.03, 'damping ratio of that mode'),
        Parameter('mass_ratio', '', 0.0, 0.9, 0.3, 'share of the moving mass behind the spring'),
        Parameter(
            'table_share',
            '',
            0.0,
            1.0,
            0.0,
            "share of the spring's deflection that the table makes; 0: the table is the motor",
            fitted=False,
        ),
    ),
    model='Two masses: a share of the moving mass hangs on a spring and a damper behind the motor'
    '. Altintas et al., "Machine tool feed drives", CIRP Annals 60 (2011), flexible drive model.',
    sentence='a share of {mass_ratio} of the moving mass swings at {frequency}',
    excited_by='a frequency sweep to 150 Hz',
)
