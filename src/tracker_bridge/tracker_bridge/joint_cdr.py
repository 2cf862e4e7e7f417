"""The part of a serialised JointState that the alignment needs.

At 1 kHz rclpy spends ten times longer on turning the message into Python objects than this
module on reading two of its fields.
"""

from __future__ import annotations

import struct

from stage_core.clocks import join_stamp

_STAMP = struct.Struct('<iI')
_LENGTH = struct.Struct('<I')


def _text_end(data: bytes, at: int) -> int:
    return at + 4 + int(_LENGTH.unpack_from(data, at)[0])


def _aligned(at: int, size: int) -> int:
    # CDR counts from behind its four bytes of encapsulation.
    return at + (4 - at) % size


def stamp_and_position(data: bytes) -> tuple[int, tuple[float, ...]]:
    """Return stamp [ns] and positions [m] of a little-endian CDR JointState.

    Raises
    ------
    ValueError
        When the data are no such message.
    """
    if data[:2] != b'\0\x01':
        raise ValueError('not little-endian CDR')
    try:
        seconds, nanoseconds = _STAMP.unpack_from(data, 4)
        at = _aligned(_text_end(data, 12), 4)
        (names,) = _LENGTH.unpack_from(data, at)
        at += 4
        if names > 16:
            raise ValueError(f'{names} joints')
        for _ in range(names):
            at = _text_end(data, _aligned(at, 4))
        at = _aligned(at, 4)
        (count,) = _LENGTH.unpack_from(data, at)
        if count > 16:
            raise ValueError(f'{count} positions')
        # An empty sequence of doubles is not followed by their padding.
        position = struct.unpack_from(f'<{count}d', data, _aligned(at + 4, 8)) if count else ()
    except struct.error as error:
        raise ValueError(str(error)) from error
    return join_stamp(seconds, nanoseconds), position
