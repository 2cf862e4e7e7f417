"""What the measurement adds: frame, latency and clock of the tracker, the encoder's quantum."""

from stage_twin.effects.definition import Effect, EffectParameter

TRACKER_MISALIGNMENT = Effect(
    'tracker_misalignment',
    'sensor',
    False,
    (
        EffectParameter('angle', 'rad', -3.2, 3.2, 100e-6, 'rotation of the frame about z'),
        EffectParameter('offset_x', 'm', -50.0, 50.0, 0.0, 'offset along x', nuisance=True),
        EffectParameter('offset_y', 'm', -50.0, 50.0, 0.0, 'offset along y', nuisance=True),
    ),
    'measured = R(+angle) * p + offset. Eq. 24 of paper 1 (rigid part).',
)

TRACKER_LATENCY = Effect(
    'tracker_latency',
    'sensor',
    False,
    (EffectParameter('latency', 's', -0.1, 0.1, 2e-3, 'age of a point at its stamp'),),
    'The point shows the table at stamp - latency. Muralikrishnan, Phillips, Sawyer, "Laser '
    'trackers for large-scale dimensional metrology: a review", Precision Engineering 44 (2016).',
)

TRACKER_CLOCK_DRIFT = Effect(
    'tracker_clock_drift',
    'sensor',
    False,
    (EffectParameter('drift', 's/s', -1e-3, 1e-3, 20e-6, 'stamp = t * (1 + drift)'),),
    "The tracker's quartz runs fast or slow; zero at the session's start. Mills, \"Computer "
    'network time synchronization" (2011), clock frequency error.',
)

ENCODER_QUANTISATION = Effect(
    'encoder_quantisation',
    'sensor',
    True,
    (
        EffectParameter(
            'resolution', 'm', 0.0, 1e-3, 5e-6, "takes the place of the file's resolution"
        ),
    ),
    'The encoder counts in steps coarser than stated. Widrow and Kollar, "Quantization noise" '
    '(2008).',
)

SENSOR_EFFECTS = (
    TRACKER_MISALIGNMENT,
    TRACKER_LATENCY,
    TRACKER_CLOCK_DRIFT,
    ENCODER_QUANTISATION,
)
