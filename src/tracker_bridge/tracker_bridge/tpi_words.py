"""Numbers of the emScon TPI: packet types, commands, results, events, units."""

from __future__ import annotations

from enum import IntEnum


class PacketType(IntEnum):
    """Second word of every packet."""

    COMMAND = 0
    ERROR = 1
    SINGLE_MEASUREMENT = 2
    MULTI_MEASUREMENT = 3
    STATIONARY_PROBE = 4
    CONTINUOUS_PROBE = 5
    NIVEL = 6
    REFLECTOR_POSITION = 7
    STATUS_CHANGE = 8
    SINGLE_MEASUREMENT_2 = 9
    MULTI_MEASUREMENT_2 = 10
    PROBE_POSITION = 11


class Command(IntEnum):
    """Commands that the public client uses."""

    GET_SYSTEM_STATUS = 1
    SET_UNITS = 5
    INITIALIZE = 7
    SET_STATION_ORIENTATION = 12
    SET_TRANSFORMATION = 14
    SET_MEASUREMENT_MODE = 24
    SET_COORDINATE_SYSTEM_TYPE = 26
    SET_CONTINUOUS_TIME_MODE_PARAMS = 30
    SET_REFLECTOR = 40
    GET_REFLECTORS = 42
    SET_SYSTEM_SETTINGS = 47
    START_MEASUREMENT = 49
    STOP_MEASUREMENT = 52
    GO_BIRD_BATH = 54
    FIND_REFLECTOR = 63
    UNKNOWN = 64


class ResultStatus(IntEnum):
    """Answers and measurement packets carry one of these (or a newer number from 10000)."""

    OK = 0
    BUSY = 1
    NOT_IMPLEMENTED = 2
    WRONG_PARAMETER = 3
    NO_TRACKER_PROCESSOR = 26
    NO_LAST_POINT = 28
    USAGE_CONFLICT = 35
    NOT_INITIALISED = 39


class PointStatus(IntEnum):
    """Status of one point of a multi-measurement packet."""

    OK = 0
    SPEED_WARNING = 1
    SPEED_EXCEEDED = 2
    PRISM_ERROR = 3
    TRIGGER_TIME_VIOLATION = 4


class Event(IntEnum):
    """Events of a status-change packet that the bridge acts on or reports."""

    UNITS_CHANGED = 6
    REFLECTOR_CHANGED = 7
    COORDINATE_SYSTEM_CHANGED = 12
    TRANSFORMATION_CHANGED = 16
    MEASUREMENT_NOT_READY = 25
    MEASUREMENT_BUSY = 26
    MEASUREMENT_READY = 27
    COUNT_REACHED = 28
    FACE_1 = 30
    FACE_2 = 31
    SERVER_CLOSING = 998


class LengthUnit(IntEnum):
    """First word of SetUnits."""

    METRE = 0
    MILLIMETRE = 1
    MICROMETRE = 2
    FOOT = 3
    YARD = 4
    INCH = 5


METRES_PER_UNIT = {
    LengthUnit.METRE: 1.0,
    LengthUnit.MILLIMETRE: 1e-3,
    LengthUnit.MICROMETRE: 1e-6,
    LengthUnit.FOOT: 0.3048,
    LengthUnit.YARD: 0.9144,
    LengthUnit.INCH: 0.0254,
}

CARTESIAN_RIGHT_HANDED = 0
CONTINUOUS_TIME_MODE = 1
