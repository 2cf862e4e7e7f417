"""CDR bytes of a JointState whose axes stay the same: one `struct` call per message.

rclpy makes and reads a JointState field by field, ten times as long, several times a tick.
What has another layout (another publisher's padding is enough) is not decoded here.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple

from stage_core.clocks import join_stamp, split_stamp

#: Little-endian plain CDR; alignment counts from behind this header.
ENCAPSULATION = b'\x00\x01\x00\x00'
_STAMP = struct.Struct('<iI')


class JointSample(NamedTuple):
    """What a JointState says: stamp [ns], axes, and position, velocity, effort or nothing."""

    stamp: int
    names: Sequence[str]
    position: Sequence[float]
    velocity: Sequence[float]
    effort: Sequence[float] = ()


class JointStateLayout:
    """Encodes and decodes the JointStates of one frame, set of axes and array lengths.

    Parameters
    ----------
    frame, names
        Frame and axes of every message.
    counts
        Lengths of position, velocity and effort: 0 or the number of axes each.
    """

    def __init__(self, frame: str, names: Sequence[str], counts: Sequence[int]) -> None:
        self.names = list(names)
        self._counts = tuple(counts)
        body = bytearray(_STAMP.size)
        append_string(body, frame)
        _append_count(body, len(self.names))
        for name in self.names:
            append_string(body, name)
        #: Everything but stamp and numbers, as (place, bytes); each follows the numbers before.
        fixed: list[bytes] = []
        begin = _STAMP.size
        for count in self._counts:
            _append_count(body, count)
            if count:
                body += bytes(-len(body) % 8)
            fixed.append(bytes(body[begin:]))
            body += bytes(8 * count)
            begin = len(body)
        self._fixed = tuple(fixed)
        parts = ''.join(
            f'{len(text)}s{count}d' for text, count in zip(fixed, self._counts, strict=True)
        )
        self._struct = struct.Struct(f'<4siI{parts}')

    def encode(
        self,
        stamp: int,
        position: Sequence[float] = (),
        velocity: Sequence[float] = (),
        effort: Sequence[float] = (),
    ) -> bytes:
        """Message of a stamp [ns]; the arrays have the lengths of the layout."""
        before_position, before_velocity, before_effort = self._fixed
        return self._struct.pack(
            ENCAPSULATION,
            *split_stamp(stamp),
            before_position,
            *position,
            before_velocity,
            *velocity,
            before_effort,
            *effort,
        )

    def decode(self, data: bytes) -> JointSample | None:
        """What a message says; None where it has another layout."""
        if len(data) < self._struct.size:
            return None
        parts = self._struct.unpack_from(data)
        positions, velocities, _ = self._counts
        second = 4 + positions
        third = second + 1 + velocities
        if (parts[0], parts[3], parts[second], parts[third]) != (ENCAPSULATION, *self._fixed):
            return None
        return JointSample(
            join_stamp(parts[1], parts[2]),
            self.names,
            parts[4:second],
            parts[second + 1 : third],
            parts[third + 1 :],
        )


def append_string(body: bytearray, text: str) -> None:
    """Append a string to the body of a CDR message."""
    data = text.encode() + b'\0'
    _append_count(body, len(data))
    body += data


def _append_count(body: bytearray, count: int) -> None:
    body += bytes(-len(body) % 4)
    body += struct.pack('<I', count)
