"""Amplifier and motor: gain, saturation, delay, offset, ripple; and the mass they move."""

from stage_twin.effects.definition import Effect, EffectParameter

INERTIA_MISMATCH = Effect(
    'inertia_mismatch',
    'servo',
    True,
    (EffectParameter('ratio', '', -0.8, 3.0, 0.1, 'moving mass = mass * (1 + ratio)'),),
    'A payload or a rotor that the nominal mass leaves out. Janot, Gautier, Brunot, EMPS (2019), '
    'inverse dynamic model.',
)

FORCE_OFFSET = Effect(
    'force_offset',
    'servo',
    True,
    (EffectParameter('offset', 'N', -200.0, 200.0, 3.0, 'constant force on the moving mass'),),
    'Constant force of the drive: current sensor offset, inclined guide, tightened cover. '
    'Janot, Gautier, Brunot, EMPS (2019), offset term.',
)

FORCE_RIPPLE = Effect(
    'force_ripple',
    'servo',
    True,
    (
        EffectParameter('amplitude', 'N', 0.0, 100.0, 2.0, 'amplitude'),
        EffectParameter(
            'period', 'm', 0.0, 0.2, 0.0, 'spatial period; 0 takes the lead', fitted=False
        ),
        EffectParameter(
            'phase', 'rad', -6.2831854, 6.2831854, 0.0, 'phase at position 0', nuisance=True
        ),
    ),
    'Force amplitude * sin(2 pi p / period + phase) on the moving mass: cogging and '
    'commutation. Jahns and Soong, "Pulsating torque minimization techniques for permanent '
    'magnet AC motor drives", IEEE Trans. Industrial Electronics 43 (1996).',
)

CABLE_FORCE = Effect(
    'cable_force',
    'servo',
    True,
    (
        EffectParameter('stiffness', 'N/m', 0.0, 2e4, 100.0, 'restoring force per displacement'),
        EffectParameter('centre', 'm', -1.0, 1.0, 0.0, 'position without cable force'),
        EffectParameter(
            'hardening', 'N/m³', 0.0, 1e6, 0.0, 'growth of the stiffness with displacement squared'
        ),
    ),
    'Force -(stiffness * s + hardening * s^3), s = p - centre: the cable chain as a spring. '
    'Altintas et al., "Machine tool feed drives", CIRP Annals 60 '
    '(2011), disturbance forces.',
)

ACTUATION_DELAY = Effect(
    'actuation_delay',
    'servo',
    True,
    (EffectParameter('delay', 's', 0.0, 0.02, 1e-3, "time added to the file's `delay`"),),
    'The force acts later by a fieldbus cycle, a computation or a filter; exact zero-order hold '
    'with the fraction of a tick. Astrom and Wittenmark, "Computer-controlled systems" (1997), '
    'sampling of systems with time delay.',
)

FORCE_SATURATION = Effect(
    'force_saturation',
    'servo',
    True,
    (
        EffectParameter(
            'limit', 'N', 0.0, 2000.0, 100.0, 'largest force that the amplifier gives; 0 is off'
        ),
    ),
    'The amplifier clips below the `force_limit` that the controller knows of, so that its '
    'integral winds up. Astrom and Hagglund, "Advanced PID control" (2006), wind-up.',
)

DRIVE_GAIN = Effect(
    'drive_gain',
    'servo',
    True,
    (EffectParameter('error', '', -0.8, 1.0, 0.05, 'acting force = (1 + error) * F'),),
    'Error of the force constant (N per ampere, N per volt). Gautier and Briot, "Global '
    'identification of joint drive gains and dynamic parameters of robots", ASME JDSMC 136 '
    '(2014).',
)

DRIVE_EFFECTS = (
    INERTIA_MISMATCH,
    FORCE_OFFSET,
    FORCE_RIPPLE,
    CABLE_FORCE,
    ACTUATION_DELAY,
    FORCE_SATURATION,
    DRIVE_GAIN,
)
