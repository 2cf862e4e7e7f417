"""A screw that grows with heat."""

from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='thermal_expansion',
    link='kinematic',
    parameters=(
        Parameter('coefficient', '1/K', -50e-6, 50e-6, 11.5e-6, 'expansion coefficient'),
        Parameter(
            'fixed_point', 'm', -2.0, 2.0, 0.0, 'position that does not move; may lie outside'
        ),
        Parameter(
            'initial_rise',
            'K',
            -30.0,
            60.0,
            2.0,
            "screw's temperature at the start above the reference (simulated temperature only)",
            nuisance=True,
            fitted=False,
        ),
        Parameter(
            'heating',
            'K·s/m',
            0.0,
            500.0,
            20.0,
            'steady rise per mean speed (simulated temperature only)',
            fitted=False,
        ),
        Parameter(
            'time_constant',
            's',
            1.0,
            1e5,
            600.0,
            "time constant of the screw's temperature (simulated temperature only)",
            fitted=False,
        ),
    ),
    model='coefficient * (T_screw - T_reference) * (p - fixed_point); without a recorded '
    'temperature the screw is one thermal mass heated in proportion to speed. Mayr et al., '
    '"Thermal issues in machine tools", CIRP Annals 61 (2012).',
    sentence='the screw grows by {coefficient} with its temperature',
    excited_by='the same grid cold and warm',
)
