"""Axes, links of the chain and names of the effects (docs/interfaces.md, "Effects")."""

from __future__ import annotations

AXES = ('x', 'y')

#: The chain from command to measurement, in the order in which a gap is searched.
LINKS = ('servo', 'kinematic', 'sensor')

SERVO_EFFECTS = (
    'inertia_mismatch',
    'viscous_friction',
    'coulomb_friction',
    'asymmetric_friction',
    'stribeck_friction',
    'force_offset',
    'force_ripple',
    'cable_force',
    'actuation_delay',
    'structural_resonance',
    'force_saturation',
    'drive_gain',
)
KINEMATIC_EFFECTS = (
    'scale_error',
    'cyclic_pitch_error',
    'nonorthogonality',
    'straightness',
    'backlash',
    'thermal_expansion',
    'angular_error',
)
SENSOR_EFFECTS = (
    'tracker_misalignment',
    'tracker_latency',
    'tracker_clock_drift',
    'encoder_quantisation',
)

#: Effect name -> link of the chain.
EFFECT_LINKS: dict[str, str] = {
    **dict.fromkeys(SERVO_EFFECTS, 'servo'),
    **dict.fromkeys(KINEMATIC_EFFECTS, 'kinematic'),
    **dict.fromkeys(SENSOR_EFFECTS, 'sensor'),
}
UNKNOWN = 'unknown'

#: Effects of the machine as a whole: they carry no axis in their name.
WITHOUT_AXIS = frozenset(
    {'nonorthogonality', 'tracker_misalignment', 'tracker_latency', 'tracker_clock_drift', UNKNOWN}
)

MICROMETRE = 1e-6


def per_axis(effect: str) -> bool:
    """Whether an effect is named with its axis, as in ``backlash.x``."""
    return effect not in WITHOUT_AXIS


def split_effect(name: str) -> tuple[str, str | None]:
    """Split ``backlash.x`` into ``('backlash', 'x')``; without an axis the second is None."""
    effect, _, axis = name.partition('.')
    return effect, axis or None
