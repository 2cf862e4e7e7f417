"""Where each parameter and state sits in the kernel's arrays.

Numba freezes these module constants into the compiled code. Per axis one row of
`AXIS_WIDTH` numbers: the fields of the twin file, then one slot per parameter of each
per-axis effect. `COMMON_WIDTH` numbers hold the effects of the machine as a whole. Zero
everywhere switches every effect off.
"""

from __future__ import annotations

from stage_twin.effects import EFFECTS

AXIS_FIELDS = (
    'mass',
    'viscous',
    'encoder_resolution',
    'lead',
    'position_gain',
    'velocity_feedforward',
    'velocity_gain',
    'integral_gain',
    'velocity_filter',
    'force_limit',
    'delay',
)


def _number(per_axis: bool, first: int) -> dict[tuple[str, str], int]:
    keys = [
        (effect.name, parameter.name)
        for effect in EFFECTS.values()
        if effect.per_axis == per_axis
        for parameter in effect.parameters
    ]
    return {key: first + index for index, key in enumerate(keys)}


#: (effect, parameter) -> column of the axis rows.
AXIS_SLOTS = _number(True, len(AXIS_FIELDS))
#: (effect, parameter) -> entry of the common array.
COMMON_SLOTS = _number(False, 0)
AXIS_WIDTH = len(AXIS_FIELDS) + len(AXIS_SLOTS)
COMMON_WIDTH = len(COMMON_SLOTS)

(
    MASS,
    VISCOUS,
    ENCODER_RESOLUTION,
    LEAD,
    POSITION_GAIN,
    VELOCITY_FEEDFORWARD,
    VELOCITY_GAIN,
    INTEGRAL_GAIN,
    VELOCITY_FILTER,
    FORCE_LIMIT,
    DELAY,
) = range(len(AXIS_FIELDS))

VISCOUS_ADDED = AXIS_SLOTS['viscous_friction', 'viscous']
COULOMB = AXIS_SLOTS['coulomb_friction', 'coulomb']
COULOMB_PRESLIDING = AXIS_SLOTS['coulomb_friction', 'presliding']
ASYMMETRIC_POSITIVE = AXIS_SLOTS['asymmetric_friction', 'coulomb_positive']
ASYMMETRIC_NEGATIVE = AXIS_SLOTS['asymmetric_friction', 'coulomb_negative']
VISCOUS_POSITIVE = AXIS_SLOTS['asymmetric_friction', 'viscous_positive']
VISCOUS_NEGATIVE = AXIS_SLOTS['asymmetric_friction', 'viscous_negative']
ASYMMETRIC_PRESLIDING = AXIS_SLOTS['asymmetric_friction', 'presliding']
STRIBECK_COULOMB = AXIS_SLOTS['stribeck_friction', 'coulomb']
STRIBECK_BREAKAWAY = AXIS_SLOTS['stribeck_friction', 'breakaway']
STRIBECK_VELOCITY = AXIS_SLOTS['stribeck_friction', 'stribeck_velocity']
STRIBECK_PRESLIDING = AXIS_SLOTS['stribeck_friction', 'presliding']
INERTIA_RATIO = AXIS_SLOTS['inertia_mismatch', 'ratio']
FORCE_OFFSET = AXIS_SLOTS['force_offset', 'offset']
RIPPLE_AMPLITUDE = AXIS_SLOTS['force_ripple', 'amplitude']
RIPPLE_PERIOD = AXIS_SLOTS['force_ripple', 'period']
RIPPLE_PHASE = AXIS_SLOTS['force_ripple', 'phase']
CABLE_STIFFNESS = AXIS_SLOTS['cable_force', 'stiffness']
CABLE_CENTRE = AXIS_SLOTS['cable_force', 'centre']
CABLE_HARDENING = AXIS_SLOTS['cable_force', 'hardening']
DELAY_ADDED = AXIS_SLOTS['actuation_delay', 'delay']
SATURATION = AXIS_SLOTS['force_saturation', 'limit']
SATURATION_KNOWN = AXIS_SLOTS['force_saturation', 'known']
FEEDFORWARD_ERROR = AXIS_SLOTS['controller_mismatch', 'velocity_feedforward_error']
#: Columns of a gain and of its relative error.
CONTROLLER_ERRORS = (
    (POSITION_GAIN, AXIS_SLOTS['controller_mismatch', 'position_gain_error']),
    (VELOCITY_GAIN, AXIS_SLOTS['controller_mismatch', 'velocity_gain_error']),
    (INTEGRAL_GAIN, AXIS_SLOTS['controller_mismatch', 'integral_gain_error']),
    (VELOCITY_FILTER, AXIS_SLOTS['controller_mismatch', 'velocity_filter_error']),
)
GAIN_ERROR = AXIS_SLOTS['drive_gain', 'error']
RESONANCE_FREQUENCY = AXIS_SLOTS['structural_resonance', 'frequency']
RESONANCE_DAMPING = AXIS_SLOTS['structural_resonance', 'damping']
RESONANCE_RATIO = AXIS_SLOTS['structural_resonance', 'mass_ratio']
RESONANCE_TABLE = AXIS_SLOTS['structural_resonance', 'table_share']
SCALE = AXIS_SLOTS['scale_error', 'error']
CYCLIC_AMPLITUDE = AXIS_SLOTS['cyclic_pitch_error', 'amplitude']
CYCLIC_PERIOD = AXIS_SLOTS['cyclic_pitch_error', 'period']
CYCLIC_PHASE = AXIS_SLOTS['cyclic_pitch_error', 'phase']
BACKLASH_WIDTH = AXIS_SLOTS['backlash', 'width']
EXPANSION = AXIS_SLOTS['thermal_expansion', 'coefficient']
FIXED_POINT = AXIS_SLOTS['thermal_expansion', 'fixed_point']
INITIAL_RISE = AXIS_SLOTS['thermal_expansion', 'initial_rise']
HEATING = AXIS_SLOTS['thermal_expansion', 'heating']
HEATING_TIME = AXIS_SLOTS['thermal_expansion', 'time_constant']
STRAIGHT_QUADRATIC = AXIS_SLOTS['straightness', 'quadratic']
STRAIGHT_CUBIC = AXIS_SLOTS['straightness', 'cubic']
STRAIGHT_CENTRE = AXIS_SLOTS['straightness', 'centre']
STRAIGHT_HALF = AXIS_SLOTS['straightness', 'half_range']
YAW_LINEAR = AXIS_SLOTS['angular_error', 'linear']
YAW_QUADRATIC = AXIS_SLOTS['angular_error', 'quadratic']
YAW_ARM = AXIS_SLOTS['angular_error', 'arm']
YAW_CENTRE = AXIS_SLOTS['angular_error', 'centre']
YAW_HALF = AXIS_SLOTS['angular_error', 'half_range']
QUANTUM = AXIS_SLOTS['encoder_quantisation', 'resolution']

SQUARENESS = COMMON_SLOTS['nonorthogonality', 'angle']
TRACKER_ANGLE = COMMON_SLOTS['tracker_misalignment', 'angle']
TRACKER_OFFSET_X = COMMON_SLOTS['tracker_misalignment', 'offset_x']
TRACKER_OFFSET_Y = COMMON_SLOTS['tracker_misalignment', 'offset_y']
TRACKER_LATENCY = COMMON_SLOTS['tracker_latency', 'latency']
TRACKER_DRIFT = COMMON_SLOTS['tracker_clock_drift', 'drift']

#: Spatial periods below this [m] stand for the lead, encoder steps below it for the file's own.
SHORTEST_LENGTH = 1e-9

# State of one axis of the plant.
POSITION, VELOCITY, DEFLECTION, DEFLECTION_RATE, BRISTLE, PLAY, RISE = range(7)
STATE_WIDTH = 7
# State of one axis of the controller.
LAST_ENCODER, FILTERED, INTEGRAL = range(3)
CONTROLLER_WIDTH = 3

# Pieces of a tick: the force before and after the delay's fraction takes effect.
PIECES = 2
# Directions with their own viscous coefficient: 0 for v < 0, 1 for v >= 0.
DIRECTIONS = 2
# Rows of a transition: motor position, motor velocity, deflection, its rate.
MOTION = 4
