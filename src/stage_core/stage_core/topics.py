"""Names and types of topics (docs/reference/interfaces.md, "Topics"): the one place."""

from __future__ import annotations

SETPOINT = '/stage/setpoint'
REFERENCE = '/stage/reference'
COMMAND = '/stage/command'
JOINT_STATES = '/stage/joint_states'
TEMPERATURE = '/stage/temperature'
CONTACT_FORCE = '/stage/contact_force'
TRACKER_POINT = '/tracker/point'
ALIGNMENT = '/tracker/alignment'
CONTOUR_ERROR = '/contour/error'
MODEL = '/calibrator/model'
CLOCK = '/clock'
DIAGNOSTICS = '/diagnostics'
#: Wanted table position; the calibrator turns it into a set-point.
TARGET = '/stage/target'

#: Topic -> message type, in ROS 2 spelling.
TOPIC_TYPES: dict[str, str] = {
    SETPOINT: 'sensor_msgs/msg/JointState',
    REFERENCE: 'sensor_msgs/msg/JointState',
    COMMAND: 'sensor_msgs/msg/JointState',
    JOINT_STATES: 'sensor_msgs/msg/JointState',
    TEMPERATURE: 'sensor_msgs/msg/Temperature',
    CONTACT_FORCE: 'geometry_msgs/msg/WrenchStamped',
    TRACKER_POINT: 'geometry_msgs/msg/PointStamped',
    ALIGNMENT: 'geometry_msgs/msg/TransformStamped',
    CONTOUR_ERROR: 'geometry_msgs/msg/Vector3Stamped',
    MODEL: 'std_msgs/msg/String',
    CLOCK: 'rosgraph_msgs/msg/Clock',
    DIAGNOSTICS: 'diagnostic_msgs/msg/DiagnosticArray',
    TARGET: 'sensor_msgs/msg/JointState',
}

#: Published once and kept for late joiners (transient local, depth 1).
LATCHED = frozenset({ALIGNMENT, MODEL})

#: What a session bag holds.
SESSION_TOPICS = (
    SETPOINT,
    REFERENCE,
    COMMAND,
    JOINT_STATES,
    TEMPERATURE,
    CONTACT_FORCE,
    TRACKER_POINT,
    ALIGNMENT,
    CONTOUR_ERROR,
    MODEL,
    DIAGNOSTICS,
)

STAGE_FRAME = 'stage'
TRACKER_FRAME = 'tracker'


def temperature_key(sensor: str) -> str:
    """Key of one temperature sensor's series in a session, as ``/stage/temperature:screw_x``."""
    return f'{TEMPERATURE}:{sensor}'
