"""The drive link: datagrams between the servo driver and a drive (here the twin's plant).

UDP on the loopback interface, little-endian. The drive is the server; the driver sends HELLO,
and again once a second until an ENCODER datagram comes. Then one ENCODER goes out per control
tick k and one FORCE with the same k comes back; it acts from t_k on.

==========  =====================================================================================
ENCODER     ``SDL1``, type 1, axes, sensors, flags; u64 tick; i64 stamp [ns]; f64 encoder
            position [m] per axis; f64 temperature [°C] per sensor
FORCE       ``SDL1``, type 2, axes, 0, flags; u64 tick; i64 stamp [ns]; f64 force [N] per axis
HELLO       ``SDL1``, type 3, 0, 0, 0; u64 0; i64 0
==========  =====================================================================================
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from stage_core.errors import StageError

HEADER = struct.Struct('<4sBBBBQq')
MAGIC = b'SDL1'
ENCODER, FORCE, HELLO = 1, 2, 3

#: Flags of an ENCODER datagram.
LOCKSTEP = 1  # the drive waits for the force of this tick
REPEATED = 2  # this tick was sent before: the drive still waits
RESET = 4  # the drive was reset: ticks start anew, the position may have jumped

#: Temperature sensors in the order in which an ENCODER datagram holds them.
SENSORS = ('screw_x', 'screw_y', 'frame', 'air')

DEFAULT_PORT = 20770
MAX_DATAGRAM = HEADER.size + 8 * 16
_VALUES = [struct.Struct(f'<{n}d') for n in range(17)]


class Datagram(NamedTuple):
    """A decoded datagram; `values` are positions [m] or forces [N]."""

    kind: int
    flags: int
    tick: int
    stamp: int
    values: tuple[float, ...]
    temperatures: tuple[float, ...] = ()


def encode_encoder(
    tick: int,
    stamp: int,
    positions: tuple[float, ...],
    temperatures: tuple[float, ...] = (),
    flags: int = 0,
) -> bytes:
    """ENCODER datagram of tick `tick` at `stamp` [ns]."""
    count = len(positions) + len(temperatures)
    return HEADER.pack(
        MAGIC, ENCODER, len(positions), len(temperatures), flags, tick, stamp
    ) + _VALUES[count].pack(*positions, *temperatures)


def encode_force(tick: int, stamp: int, forces: tuple[float, ...]) -> bytes:
    """FORCE datagram that answers tick `tick`."""
    return HEADER.pack(MAGIC, FORCE, len(forces), 0, 0, tick, stamp) + _VALUES[len(forces)].pack(
        *forces
    )


def encode_hello() -> bytes:
    """HELLO datagram: tells the drive where its driver listens."""
    return HEADER.pack(MAGIC, HELLO, 0, 0, 0, 0, 0)


def decode(data: bytes) -> Datagram:
    """Decode a datagram.

    Raises
    ------
    StageError
        If it is not one of the drive link's, is truncated, or holds too many values.
    """
    if len(data) < HEADER.size or data[:4] != MAGIC:
        raise StageError('a datagram on the drive link is not of the protocol SDL1')
    _, kind, axes, sensors, flags, tick, stamp = HEADER.unpack_from(data)
    count = axes + sensors
    if kind not in (ENCODER, FORCE, HELLO) or count > 16 or len(data) != HEADER.size + 8 * count:
        raise StageError('a datagram on the drive link is truncated or of an unknown type')
    values = _VALUES[count].unpack_from(data, HEADER.size)
    return Datagram(kind, flags, tick, stamp, values[:axes], values[axes:])
