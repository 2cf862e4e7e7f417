"""Along one axis, from motor to nut: scale, cyclic pitch error, backlash, heat."""

from stage_twin.effects.definition import Effect, EffectParameter

SCALE_ERROR = Effect(
    'scale_error',
    'kinematic',
    True,
    (EffectParameter('error', 'm/m', -0.01, 0.01, 50e-6, 'table = p * (1 + error)'),),
    'Mean pitch error of the screw or the scale. ISO 230-2:2014; paper 1, section 2.',
)

CYCLIC_PITCH_ERROR = Effect(
    'cyclic_pitch_error',
    'kinematic',
    True,
    (
        EffectParameter('amplitude', 'm', 0.0, 200e-6, 3e-6, 'amplitude'),
        EffectParameter(
            'period', 'm', 0.0, 0.2, 0.0, 'spatial period; 0 takes the lead', fitted=False
        ),
        EffectParameter(
            'phase', 'rad', -6.2831854, 6.2831854, 0.0, 'phase at position 0', nuisance=True
        ),
    ),
    'amplitude * sin(2 pi p / period + phase) along the axis: wobble and eccentricity of the '
    'screw. ISO 230-2:2014, intra-pitch deviation; Slocum, "Precision machine design" (1992).',
)

BACKLASH = Effect(
    'backlash',
    'kinematic',
    True,
    (EffectParameter('width', 'm', 0.0, 1e-3, 10e-6, 'full width of the play'),),
    'Play operator between motor and table, centred at the start of a session. Nordin and '
    'Gutman, "Controlling mechanical systems with backlash: a survey", Automatica 38 (2002).',
)

THERMAL_EXPANSION = Effect(
    'thermal_expansion',
    'kinematic',
    True,
    (
        EffectParameter('coefficient', '1/K', -50e-6, 50e-6, 11.5e-6, 'expansion coefficient'),
        EffectParameter(
            'fixed_point', 'm', -2.0, 2.0, 0.0, 'position that does not move; may lie outside'
        ),
        EffectParameter(
            'initial_rise',
            'K',
            -30.0,
            60.0,
            2.0,
            "screw's temperature at the start above the reference (simulated temperature only)",
            nuisance=True,
            fitted=False,
        ),
        EffectParameter(
            'heating',
            'K·s/m',
            0.0,
            500.0,
            20.0,
            'steady rise per mean speed (simulated temperature only)',
            fitted=False,
        ),
        EffectParameter(
            'time_constant',
            's',
            1.0,
            1e5,
            600.0,
            "time constant of the screw's temperature (simulated temperature only)",
            fitted=False,
        ),
    ),
    'coefficient * (T_screw - T_reference) * (p - fixed_point); without a recorded temperature '
    'the screw is one thermal mass heated in proportion to speed. Mayr et al., "Thermal issues '
    'in machine tools", CIRP Annals 61 (2012).',
)

SCREW_EFFECTS = (SCALE_ERROR, CYCLIC_PITCH_ERROR, BACKLASH, THERMAL_EXPANSION)
