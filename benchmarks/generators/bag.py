"""Writes a record as a session bag (interfaces.md, "Session bag"), with rosbags alone."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from .machine import AXES
from .record import Record

EPOCH = 1_760_000_000_000_000_000
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
Stamp = TYPES['builtin_interfaces/msg/Time']
Header = TYPES['std_msgs/msg/Header']
JointState = TYPES['sensor_msgs/msg/JointState']
PointStamped = TYPES['geometry_msgs/msg/PointStamped']
Point = TYPES['geometry_msgs/msg/Point']
Temperature = TYPES['sensor_msgs/msg/Temperature']
TOPICS = {
    '/stage/reference': JointState,
    '/stage/command': JointState,
    '/stage/joint_states': JointState,
    '/tracker/point': PointStamped,
    '/stage/temperature': Temperature,
}
NOTHING = np.zeros(0)
Timed = list[tuple[int, str, bytes]]


def write_bag(record: Record, path: Path, axes: int = 2, tracker: bool = True) -> None:
    """Writes the first `axes` axes; an existing folder at `path` is replaced."""
    shutil.rmtree(path, ignore_errors=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    messages = _joints(record, axes) + _temperatures(record)
    if tracker:
        messages += _points(record, axes)
    messages.sort(key=lambda message: message[0])
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            topic: writer.add_connection(topic, kind.__msgtype__, typestore=STORE)
            for topic, kind in TOPICS.items()
        }
        for stamp, topic, content in messages:
            writer.write(connections[topic], stamp, content)


def _joints(record: Record, axes: int) -> Timed:
    names = list(AXES[:axes])
    columns = [
        np.ascontiguousarray(column[:, :axes])
        for column in (
            record.reference,
            record.reference_velocity,
            record.command,
            record.effort,
            record.encoder,
            record.velocity,
        )
    ]
    messages: Timed = []
    for k, stamp in enumerate(_nanoseconds(record.stamps)):
        header = _header(stamp)
        r, rd, command, effort, encoder, velocity = (column[k] for column in columns)
        for topic, message in (
            ('/stage/reference', JointState(header, names, r, rd, NOTHING)),
            ('/stage/command', JointState(header, names, NOTHING, command, effort)),
            ('/stage/joint_states', JointState(header, names, encoder, velocity, NOTHING)),
        ):
            messages.append((stamp, topic, _bytes(message)))
    return messages


def _points(record: Record, axes: int) -> Timed:
    messages: Timed = []
    for stamp, (x, y) in zip(_nanoseconds(record.tracker_stamps), record.tracker, strict=True):
        point = Point(float(x), float(y) if axes > 1 else 0.0, 0.0)
        message = PointStamped(_header(stamp, 'tracker'), point)
        messages.append((stamp, '/tracker/point', _bytes(message)))
    return messages


def _temperatures(record: Record) -> Timed:
    messages: Timed = []
    for sensor, values in record.temperatures.items():
        for stamp, value in zip(_nanoseconds(record.temperature_stamps), values, strict=True):
            message = Temperature(_header(stamp, sensor), float(value), 0.0)
            messages.append((stamp, '/stage/temperature', _bytes(message)))
    return messages


def _nanoseconds(seconds: np.ndarray) -> list[int]:
    return [EPOCH + int(value) for value in np.round(seconds * 1e9).astype(np.int64)]


def _header(stamp: int, frame: str = '') -> object:
    return Header(stamp=Stamp(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id=frame)


def _bytes(message: object) -> bytes:
    return bytes(STORE.serialize_cdr(message, message.__msgtype__))  # type: ignore[attr-defined]
