"""Packets of the Leica emScon TPI (binary TCP): encode, decode and split a byte stream.

Layout: little-endian, C structures packed to 4 bytes; ``long``, enumerations and booleans take
4 bytes, ``double`` 8 bytes. Every packet starts with its total size and its type. Quantities are
in the units that were last set with SetUnits (metres until then); this module does not convert.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np

from tracker_bridge.tpi_packets import (
    POINT,
    POINT_2,
    Answer,
    CommandPacket,
    ErrorPacket,
    MultiMeasurement,
    OtherPacket,
    ServerPacket,
    SingleMeasurement,
    StatusChange,
    TpiError,
)
from tracker_bridge.tpi_words import (
    Command,
    PacketType,
    ResultStatus,
)

HEADER = struct.Struct('<ii')
MAXIMUM_SIZE = 65536


def _packet(kind: int, body: bytes) -> bytes:
    return HEADER.pack(HEADER.size + len(body), kind) + body


def encode_command(command: int, *arguments: int) -> bytes:
    """Encode a command with 32-bit integer arguments."""
    body = struct.pack(f'<{1 + len(arguments)}i', command, *arguments)
    return _packet(PacketType.COMMAND, body)


def encode_answer(command: int, status: int = 0, payload: bytes = b'') -> bytes:
    """Encode the answer to a command."""
    return _packet(PacketType.COMMAND, struct.pack('<ii', command, status) + payload)


def encode_error(command: int, status: int) -> bytes:
    """Encode an unsolicited error."""
    return _packet(PacketType.ERROR, struct.pack('<ii', command, status))


def encode_status_change(event: int) -> bytes:
    """Encode an event."""
    return _packet(PacketType.STATUS_CHANGE, struct.pack('<i', event))


def encode_single(measurement: SingleMeasurement) -> bytes:
    """Encode a stationary point; pointing errors and a-priori deviations are written as zero."""
    body = struct.pack(
        '<iii17d',
        measurement.status,
        measurement.mode,
        measurement.tries,
        *measurement.values,
        *measurement.standard_deviations,
        measurement.total_deviation,
        *([0.0] * 7),
        measurement.temperature,
        measurement.pressure,
        measurement.humidity,
    )
    return _packet(PacketType.SINGLE_MEASUREMENT, body)


def encode_multi(measurement: MultiMeasurement) -> bytes:
    """Encode the points of a continuous measurement, dtype `POINT` or `POINT_2`."""
    kind = PacketType.MULTI_MEASUREMENT
    if measurement.points.dtype == POINT_2:
        kind = PacketType.MULTI_MEASUREMENT_2
    head = struct.pack(
        '<iiii3d',
        measurement.status,
        len(measurement.points),
        measurement.mode,
        measurement.tries,
        measurement.temperature,
        measurement.pressure,
        measurement.humidity,
    )
    return _packet(kind, head + measurement.points.tobytes())


def encode_reflectors(identifier: int, kind: int, surface_offset: float, name: str) -> bytes:
    """Encode the 100-byte answer to GetReflectors for a tracker with one reflector."""
    text = name[:32].encode('utf-16-le').ljust(64, b'\0')[:64]
    payload = struct.pack('<iiid', 1, identifier, kind, surface_offset) + text
    return encode_answer(Command.GET_REFLECTORS, ResultStatus.OK, payload)


def _multi(body: bytes, record: np.dtype) -> MultiMeasurement:
    status, count, mode, tries, temperature, pressure, humidity = struct.unpack_from(
        '<iiii3d', body
    )
    if count < 0 or len(body) != 40 + record.itemsize * count:
        raise TpiError(
            f'measurement packet of {len(body) + 8} bytes announces {count} points: '
            'the stream is damaged, connect again'
        )
    points = np.frombuffer(body, dtype=record, offset=40).copy()
    return MultiMeasurement(status, mode, tries, temperature, pressure, humidity, points)


def _single(body: bytes) -> SingleMeasurement:
    status, mode, tries, *numbers = struct.unpack_from('<iii17d', body)
    values, deviations = tuple(numbers[:3]), tuple(numbers[3:6])
    return SingleMeasurement(status, mode, tries, values, deviations, numbers[6], *numbers[14:])


def decode(packet: bytes) -> ServerPacket:
    """Decode one whole packet that a tracker sent; raises `TpiError` when it is none."""
    if len(packet) < HEADER.size:
        raise TpiError(f'packet of {len(packet)} bytes: connect again')
    size, kind = HEADER.unpack_from(packet)
    body = packet[HEADER.size :]
    try:
        if size != len(packet):
            raise TpiError(f'packet of {len(packet)} bytes announces {size}: connect again')
        if kind == PacketType.MULTI_MEASUREMENT:
            return _multi(body, POINT)
        if kind == PacketType.MULTI_MEASUREMENT_2:
            return _multi(body, POINT_2)
        if kind == PacketType.COMMAND:
            command, status = struct.unpack_from('<ii', body)
            return Answer(command, status, body[8:])
        if kind == PacketType.ERROR:
            return ErrorPacket(*struct.unpack_from('<ii', body))
        if kind == PacketType.STATUS_CHANGE:
            return StatusChange(*struct.unpack_from('<i', body))
        if kind == PacketType.SINGLE_MEASUREMENT:
            return _single(body)
    except struct.error as error:
        raise TpiError(
            f'packet of type {kind} with {size} bytes is too short: connect again'
        ) from error
    return OtherPacket(kind, body)


def decode_command(packet: bytes) -> CommandPacket:
    """Decode one whole packet that a client sent; raises `TpiError` when it is no command."""
    if len(packet) < 12 or len(packet) % 4:
        raise TpiError(f'command of {len(packet)} bytes: a command has 12 or more, in words')
    size, kind, command, *arguments = struct.unpack(f'<{len(packet) // 4}i', packet)
    if size != len(packet) or kind != PacketType.COMMAND:
        raise TpiError(f'packet of type {kind} from a client: only commands are understood')
    return CommandPacket(command, tuple(arguments))


class StreamSplitter:
    """Cut a TCP byte stream into whole packets, holding at most one incomplete packet.

    A size or type that no packet can have means that the position in the stream is lost (TPI has
    no mark to find it again): `feed` raises `TpiError` and the connection must be opened again.
    """

    def __init__(self, maximum_size: int = MAXIMUM_SIZE) -> None:
        self._buffer = bytearray()
        self._maximum_size = maximum_size

    def __len__(self) -> int:
        """Return the number of bytes of the incomplete packet held."""
        return len(self._buffer)

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Add received bytes; yield every packet that is now whole."""
        self._buffer += data
        position = 0
        try:
            while len(self._buffer) - position >= HEADER.size:
                size, kind = HEADER.unpack_from(self._buffer, position)
                if not HEADER.size < size <= self._maximum_size or not 0 <= kind <= 11:
                    position = len(self._buffer)
                    raise TpiError(
                        f'no TPI packet (size {size}, type {kind}): check that the port is the '
                        "tracker's TPI port, then connect again"
                    )
                if len(self._buffer) - position < size:
                    return
                packet = bytes(self._buffer[position : position + size])
                position += size
                yield packet
        finally:
            del self._buffer[:position]
