"""Bags made by hand with public libraries alone, of a machine that is not the twin."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
import yaml
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

from benchmarks.blind.machine import NOMINAL, Recording, record

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
EPOCH = 1.7e9  # s
JOINTS, POINT = 'sensor_msgs/msg/JointState', 'geometry_msgs/msg/PointStamped'
TEMPERATURE, TEXT = 'sensor_msgs/msg/Temperature', 'std_msgs/msg/String'
EMPTY = np.zeros(0)

#: Topic, time of arrival [ns], message type, CDR bytes.
Message = tuple[str, int, str, bytes]


@lru_cache(maxsize=8)
def machine(
    seed: int = 5, axes: tuple[str, ...] = ('x', 'y'), rate: float = 100.0, duration: float = 10.0
) -> Recording:
    """A recording of the blind machine with friction on x, and play on the last axis."""
    truth = {
        'coulomb_friction.x': {
            'coulomb_positive': 8.0,
            'coulomb_negative': 8.0,
            'presliding': 4e-6,
        },
        f'backlash.{axes[-1]}': {'width': 12e-6},
    }
    return record(truth, seed, axes, duration, rate)


def twin(axes: Sequence[str] = ('x', 'y')) -> dict:
    """Content of the machine's nominal twin file, as a person writes it."""
    return {**NOMINAL, 'axes': {a: NOMINAL['axes'][a] for a in axes}}


@dataclass
class Shape:
    """How a foreign recorder writes the same recording."""

    start: float = EPOCH  # s, first stamp
    order: tuple[str, ...] = ()  # of the names in JointState; empty: that of the axes
    keep: np.ndarray | None = None  # rows of the ticks that were recorded
    tracker_offset: float = 0.0  # s, of the tracker's stamps
    tracker: bool = True
    temperature: bool = True
    stamped: bool = True  # whether headers hold a stamp
    full: bool = True  # whether velocity and effort are filled where they may be empty
    effort: bool = True  # whether the commands hold the force
    extra: bool = False  # topics that nobody knows
    late: dict[str, float] = field(default_factory=dict)  # s, added to the stamps of a topic


def stamp_of(time: int) -> object:
    """A header stamp of a time [ns]."""
    return TYPES['builtin_interfaces/msg/Time'](sec=time // 10**9, nanosec=time % 10**9)


def messages(recording: Recording, shape: Shape) -> list[Message]:
    """The recording as messages in the order of their arrival."""
    header = TYPES['std_msgs/msg/Header']
    out: list[Message] = []
    order = shape.order or recording.axes
    columns = [recording.axes.index(name) for name in order]
    keep = np.arange(len(recording.time)) if shape.keep is None else shape.keep

    def add(
        topic: str, kind: str, second: float, frame: str, delay: int, **values: object
    ) -> None:
        time = round((shape.start + second + shape.late.get(topic, 0.0)) * 1e9)
        head = header(stamp=stamp_of(time if shape.stamped else 0), frame_id=frame)
        message = TYPES[kind](header=head, **values)
        out.append((topic, time + delay, kind, bytes(STORE.serialize_cdr(message, kind))))

    def joints(topic: str, position: object, velocity: object, effort: object) -> None:
        for k in keep:
            rows = [
                np.ascontiguousarray(part[k, columns]) if part is not None else EMPTY
                for part in (position, velocity, effort)
            ]
            add(
                topic, JOINTS, float(recording.time[k]), '', 50_000,
                name=list(order), position=rows[0], velocity=rows[1], effort=rows[2],
            )  # fmt: skip

    r = recording
    joints('/stage/reference', r.reference, r.reference_velocity if shape.full else None, None)
    joints('/stage/command', None, r.velocity_command, r.force if shape.effort else None)
    joints('/stage/joint_states', r.encoder, r.filtered_velocity if shape.full else None, None)
    if shape.tracker:
        point = TYPES['geometry_msgs/msg/Point']
        for second, p in zip(r.tracker_time, r.tracker, strict=True):
            place = {a: float(v) for a, v in zip(r.axes, p, strict=True)}
            add(
                '/tracker/point', POINT, float(second) + shape.tracker_offset, 'tracker',
                3_000_000, point=point(x=place.get('x', 0.0), y=place.get('y', 0.0), z=0.0),
            )  # fmt: skip
    if shape.temperature:
        for i, axis in enumerate(r.axes):
            for second, celsius in zip(r.temperature_time, r.temperature[:, i], strict=True):
                add(
                    '/stage/temperature', TEMPERATURE, float(second), f'screw_{axis}', 0,
                    temperature=float(celsius), variance=0.0,
                )  # fmt: skip
    if shape.extra:
        text = bytes(STORE.serialize_cdr(TYPES[TEXT](data='hello'), TEXT))
        start = round(shape.start * 1e9)
        out += [('/somebody/else', start + k * 10**8, TEXT, text) for k in range(50)]
        out += [('/private/blob', start + k * 10**8, 'acme_msgs/msg/Blob', b'\x00\x01\x00\x00abc')
                for k in range(50)]  # fmt: skip
    return sorted(out, key=lambda m: m[1])


def write_mcap(
    path: Path,
    content: Iterable[Message],
    compression: CompressionType = CompressionType.NONE,
    chunked: bool = True,
) -> Path:
    """Write messages to one mcap file with the format's own library."""
    with open(path, 'wb') as stream:
        writer = Writer(stream, compression=compression, use_chunking=chunked)
        writer.start(profile='ros2', library='by hand')
        channels: dict[str, int] = {}
        for topic, time, kind, data in content:
            if topic not in channels:
                text = 'uint8[] blob\n'
                if kind in TYPES:
                    text = STORE.generate_msgdef(kind, ros_version=2)[0]
                schema = writer.register_schema(kind, 'ros2msg', text.encode())
                channels[topic] = writer.register_channel(topic, 'cdr', schema)
            writer.add_message(channels[topic], log_time=time, publish_time=time, data=data)
        writer.finish()
    return path


def write_bag(
    folder: Path,
    content: Sequence[Message],
    files: int = 1,
    metadata: bool = True,
    compression: CompressionType = CompressionType.NONE,
    chunked: bool = True,
) -> Path:
    """Write a bag's directory: its messages dealt over some files, and its metadata."""
    folder.mkdir(parents=True)
    names = []
    for k, part in enumerate(np.array_split(np.arange(len(content)), files)):
        names.append(f'{folder.name}_{k}.mcap')
        write_mcap(folder / names[-1], [content[i] for i in part], compression, chunked)
    if metadata:
        counts: dict[tuple[str, str], int] = {}
        for topic, _, kind, _ in content:
            counts[topic, kind] = counts.get((topic, kind), 0) + 1
        begin, end = content[0][1], content[-1][1]
        topics = [
            {
                'topic_metadata': {
                    'name': topic, 'type': kind, 'serialization_format': 'cdr',
                    'offered_qos_profiles': '',
                },
                'message_count': count,
            }
            for (topic, kind), count in counts.items()
        ]  # fmt: skip
        inner = {
            'version': 5, 'storage_identifier': 'mcap',
            'duration': {'nanoseconds': end - begin},
            'starting_time': {'nanoseconds_since_epoch': begin},
            'message_count': len(content), 'topics_with_message_count': topics,
            'compression_format': '', 'compression_mode': '', 'relative_file_paths': names,
        }  # fmt: skip
        text = yaml.safe_dump({'rosbag2_bagfile_information': inner})
        (folder / 'metadata.yaml').write_text(text)
    return folder
