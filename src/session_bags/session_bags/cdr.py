"""Layouts of CDR messages with numbers only, and encoding and decoding by NumPy.

A message of the session's topics differs from its neighbour in the stamp and in a few doubles;
all other bytes (encapsulation, frame, joint names, lengths) repeat. :func:`layout_of` walks one
message and says where the stamp and the doubles lie; a block of messages that agree with it in
every other byte is then decoded without a loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.ros.joint_state_wire import ENCAPSULATION, JointStateLayout, append_string

Bytes = NDArray[np.uint8]

_ENCAPSULATION = 4
#: A writer may fill the message up to the next multiple of four.
_MAX_TRAILING = 3


class LayoutError(ValueError):
    """The bytes are not a message of the expected type."""


@dataclass(frozen=True)
class Layout:
    """Where the numbers of a message lie, and the bytes that never change.

    Attributes
    ----------
    size : int
        Length of the message [byte].
    frame : str
        ``frame_id`` of the header.
    child_frame : str
        ``child_frame_id`` of a transform, else empty.
    fields : tuple of (str, int)
        Column name and offset of each double.
    template, mask : uint8 arrays of shape (size,)
        The message that the layout was made from; 255 where another message must agree.
    """

    size: int
    frame: str
    child_frame: str
    fields: tuple[tuple[str, int], ...]
    template: Bytes
    mask: Bytes

    def record(self) -> np.dtype:
        """Structured type of a message: ``sec``, ``nanosec`` and one double per field."""
        return np.dtype(
            {
                'names': ['sec', 'nanosec', *(name for name, _ in self.fields)],
                'formats': ['<i4', '<u4', *('<f8' for _ in self.fields)],
                # The header's stamp comes first, behind the encapsulation.
                'offsets': [4, 8, *(offset for _, offset in self.fields)],
                'itemsize': self.size,
            }
        )


class _Walker:
    """Reads one message in order, noting which bytes are constant."""

    def __init__(self, data: bytes) -> None:
        if len(data) < _ENCAPSULATION or data[:2] != ENCAPSULATION[:2]:
            raise LayoutError('not little-endian CDR')
        self.data = data
        self.position = _ENCAPSULATION
        self.mask = np.zeros(len(data), np.uint8)
        self.mask[:2] = 255
        self.fields: list[tuple[str, int]] = []

    def take(self, size: int, alignment: int, constant: bool = True) -> bytes:
        """Skip to the alignment and read `size` bytes."""
        offset = (self.position - _ENCAPSULATION) % alignment
        begin = self.position + (alignment - offset if offset else 0)
        if begin + size > len(self.data):
            raise LayoutError('the message ends early')
        if constant:
            self.mask[begin : begin + size] = 255
        self.position = begin + size
        return self.data[begin : begin + size]

    def length(self) -> int:
        return int.from_bytes(self.take(4, 4), 'little')

    def string(self) -> str:
        raw = self.take(self.length(), 1)
        return raw.rstrip(b'\0').decode('utf-8', 'replace')

    def doubles(self, *names: str) -> None:
        for name in names:
            self.take(8, 8, constant=False)
            self.fields.append((name, self.position - 8))

    def sequence(self, quantity: str, names: Sequence[str]) -> None:
        """A sequence of doubles: empty, or one per joint name."""
        count = self.length()
        if count not in (0, len(names)):
            raise LayoutError(f'{len(names)} joint names but {count} values of {quantity}')
        self.doubles(*(f'{quantity}.{name}' for name in names[:count]))


JOINT_STATE = 'sensor_msgs/msg/JointState'
QUANTITIES = ('position', 'velocity', 'effort')


def _joint_state(walk: _Walker) -> None:
    names = [walk.string() for _ in range(min(walk.length(), len(walk.data)))]
    if len(set(names)) != len(names):
        raise LayoutError('a joint is named twice')
    for quantity in QUANTITIES:
        walk.sequence(quantity, names)


_TRANSFORM = 'geometry_msgs/msg/TransformStamped'
#: Types that hold nothing but doubles behind header and child frame, and the names of these.
_DOUBLES: dict[str, tuple[str, ...]] = {
    'sensor_msgs/msg/Temperature': ('temperature', 'variance'),
    'geometry_msgs/msg/PointStamped': ('x', 'y', 'z'),
    'geometry_msgs/msg/Vector3Stamped': ('x', 'y', 'z'),
    'geometry_msgs/msg/WrenchStamped': tuple(
        f'{part}.{axis}' for part in ('force', 'torque') for axis in 'xyz'
    ),
    _TRANSFORM: (
        *(f'translation.{axis}' for axis in 'xyz'),
        *(f'rotation.{axis}' for axis in 'xyzw'),
    ),
}
NUMERIC_TYPES = frozenset({JOINT_STATE, *_DOUBLES})


def layout_of(type_name: str, data: bytes) -> Layout:
    """Layout of one message of a numeric type.

    Raises
    ------
    LayoutError
        If the bytes are not such a message in little-endian CDR.
    """
    walk = _Walker(data)
    walk.take(8, 4, constant=False)
    frame = walk.string()
    child = walk.string() if type_name == _TRANSFORM else ''
    if type_name == JOINT_STATE:
        _joint_state(walk)
    else:
        walk.doubles(*_DOUBLES[type_name])
    if len(data) - walk.position > _MAX_TRAILING:
        raise LayoutError('the message is longer than its type')
    return Layout(
        size=len(data),
        frame=frame,
        child_frame=child,
        fields=tuple(walk.fields),
        template=np.frombuffer(data, np.uint8),
        mask=walk.mask,
    )


def blank_layout(
    type_name: str,
    frame: str,
    joints: Sequence[str] = (),
    quantities: Sequence[str] = (),
    child_frame: str = '',
) -> Layout:
    """Layout of a message yet to be filled: numbers zero.

    `joints` and `quantities` (of ``position``, ``velocity``, ``effort``) matter to a JointState.
    """
    if type_name == JOINT_STATE:
        counts = [len(joints) if quantity in quantities else 0 for quantity in QUANTITIES]
        wire = JointStateLayout(frame, joints, counts)
        return layout_of(type_name, wire.encode(0, *([0.0] * count for count in counts)))
    body = bytearray(8)
    append_string(body, frame)
    if type_name == _TRANSFORM:
        append_string(body, child_frame)
    body += bytes(-len(body) % 8 + 8 * len(_DOUBLES[type_name]))
    return layout_of(type_name, ENCAPSULATION + bytes(body))


def encode(layout: Layout, stamps: NDArray[np.int64], columns: dict[str, Array]) -> Bytes:
    """Messages of one layout, shape (n, size); a field without a column is zero."""
    rows = np.tile(layout.template, (len(stamps), 1))
    records = rows.reshape(-1).view(layout.record())
    records['sec'] = stamps // 1_000_000_000
    records['nanosec'] = stamps % 1_000_000_000
    for name, _ in layout.fields:
        if name in columns:
            records[name] = columns[name]
    return rows


def stamp_in(data: bytes) -> int:
    """Stamp [ns] of a little- or big-endian message whose first field is a header.

    Raises
    ------
    StageError
        If the message is too short to hold one.
    """
    if len(data) < _ENCAPSULATION + 8:
        raise StageError('a message is too short to hold a header: it is no message of its type')
    order = 'little' if data[1] & 1 else 'big'
    seconds = int.from_bytes(data[4:8], order, signed=True)  # type: ignore[arg-type]
    return seconds * 1_000_000_000 + int.from_bytes(data[8:12], order)  # type: ignore[arg-type]
