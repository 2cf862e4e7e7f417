"""The TPI codec against vectors made from the vendor's structures, and against damage."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tracker_bridge import tpi
from tracker_bridge.tpi_packets import (
    POINT_2,
    Answer,
    CommandPacket,
    ErrorPacket,
    MultiMeasurement,
    SingleMeasurement,
    StatusChange,
    TpiError,
)
from tracker_bridge.tpi_words import Command, Event, LengthUnit, PointStatus, ResultStatus

MULTI = bytes.fromhex(
    '78000000030000000000000002000000010000000000000000000000008034400000000000aa8f4000000000'
    '00804640000000000c000000a84305000000000000448f400000000000419fc0000000000000c03f01000000'
    '0c0000009047050000000000004c8f400000000000419fc0000000000000c03f'
)
SINGLE = bytes.fromhex(
    '9c00000002000000000000000000000000000000000000000000f83f00000000000004400000000000000c40'
    'fca9f1d24d62503ffca9f1d24d62603ffa7e6abc7493683ffca9f1d24d62703f' + '00' * 56 + ''
    '00000000000034400000000000a88f400000000000004940'
)


def test_multi_measurement_golden_vector():
    packet = tpi.decode(MULTI)
    assert isinstance(packet, MultiMeasurement)
    assert (packet.status, packet.mode, packet.tries) == (0, 1, 0)
    assert (packet.temperature, packet.pressure, packet.humidity) == (20.5, 1013.25, 45.0)
    assert packet.times_ns().tolist() == [12_345_000_000, 12_346_000_000]
    assert packet.points['status'].tolist() == [0, PointStatus.SPEED_WARNING]
    assert packet.points['values'].tolist() == [
        [1000.5, -2000.25, 0.125],
        [1001.5, -2000.25, 0.125],
    ]
    assert tpi.encode_multi(packet) == MULTI


def test_single_measurement_golden_vector():
    assert len(SINGLE) == 156
    packet = tpi.decode(SINGLE)
    assert isinstance(packet, SingleMeasurement)
    assert packet.values == (1.5, 2.5, 3.5)
    assert packet.standard_deviations == (1e-3, 2e-3, 3e-3)
    assert packet.total_deviation == 4e-3
    assert (packet.temperature, packet.pressure, packet.humidity) == (20.0, 1013.0, 50.0)
    assert tpi.encode_single(packet) == SINGLE


def test_short_golden_vectors():
    change = bytes.fromhex('0c000000080000001b000000')
    assert tpi.decode(change) == StatusChange(Event.MEASUREMENT_READY)
    assert tpi.encode_status_change(27) == change
    error = bytes.fromhex('1000000001000000400000001a000000')
    assert tpi.decode(error) == ErrorPacket(64, ResultStatus.NO_TRACKER_PROCESSOR)
    assert tpi.encode_error(64, 26) == error
    units = bytes.fromhex('2000000000000000050000000100000000000000000000000000000000000000')
    assert tpi.encode_command(Command.SET_UNITS, LengthUnit.MILLIMETRE, 0, 0, 0, 0) == units
    assert tpi.decode_command(units) == CommandPacket(5, (1, 0, 0, 0, 0))
    start = bytes.fromhex('0c0000000000000031000000')
    assert tpi.encode_command(Command.START_MEASUREMENT) == start
    answer = bytes.fromhex('10000000000000003100000000000000')
    assert tpi.decode(answer) == Answer(Command.START_MEASUREMENT, 0)
    assert tpi.encode_answer(Command.START_MEASUREMENT) == answer


@pytest.mark.parametrize(
    ('command', 'arguments', 'size'),
    [(24, 1, 16), (26, 1, 16), (40, 1, 16), (30, 4, 28), (47, 9, 48), (1, 0, 12)],
)
def test_command_sizes(command, arguments, size):
    assert len(tpi.encode_command(command, *range(arguments))) == size


def test_multi_2_keeps_covariances():
    points = np.zeros(2, POINT_2)
    points['values'] = [[1, 2, 3], [4, 5, 6]]
    points['covariances'] = [[7, 8, 9], [10, 11, 12]]
    data = tpi.encode_multi(MultiMeasurement(0, 1, 0, 20.0, 1013.0, 40.0, points))
    assert len(data) == 48 + 92 * 2
    assert struct.unpack_from('<3d', data, 48 + 68) == (7.0, 8.0, 9.0)
    decoded = tpi.decode(data)
    assert isinstance(decoded, MultiMeasurement)
    assert np.array_equal(decoded.points, points)


def test_reflector_answer_has_its_fields():
    data = tpi.encode_reflectors(3, 1, -0.019, 'RRR 1.5in')
    assert len(data) == 100
    answer = tpi.decode(data)
    assert isinstance(answer, Answer)
    assert struct.unpack_from('<iiid', answer.payload) == (1, 3, 1, -0.019)
    assert answer.payload[20:].decode('utf-16-le').rstrip('\0') == 'RRR 1.5in'


@settings(max_examples=60, deadline=None)
@given(st.lists(st.sampled_from([MULTI, SINGLE, tpi.encode_answer(49)]), max_size=6), st.data())
def test_splitter_does_not_care_where_the_stream_is_cut(packets, data):
    stream = b''.join(packets)
    splitter = tpi.StreamSplitter()
    received = []
    position = 0
    while position < len(stream):
        step = data.draw(st.integers(1, 200))
        received += splitter.feed(stream[position : position + step])
        position += step
    assert received == packets
    assert len(splitter) == 0


@settings(max_examples=300, deadline=None)
@given(st.integers(0, 11), st.binary(max_size=250))
def test_any_body_of_any_type_decodes_or_is_refused(kind, body):
    data = tpi.HEADER.pack(8 + len(body), kind) + body
    try:
        packet = tpi.decode(data)
    except TpiError:
        return
    assert packet is not None
    if isinstance(packet, MultiMeasurement):
        assert len(packet.times_ns()) == len(packet.points)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=120))
def test_any_command_decodes_or_is_refused(data):
    try:
        command = tpi.decode_command(data)
    except TpiError:
        return
    assert tpi.encode_command(command.command, *command.arguments) == data


def test_splitter_is_bounded_by_the_largest_packet():
    splitter = tpi.StreamSplitter(maximum_size=1000)
    list(splitter.feed(tpi.HEADER.pack(1000, 3)))
    for _ in range(9):
        assert list(splitter.feed(b'\0' * 100)) == []
    assert len(splitter) <= 1000
    with pytest.raises(TpiError, match='connect again'):
        list(tpi.StreamSplitter(maximum_size=1000).feed(tpi.HEADER.pack(1001, 3)))
