"""Sources against the emulated tracker, over real sockets, with every fault."""

import contextlib
import socket
import struct

import pytest

from stage_bringup.graph import free_port
from stage_core.errors import StageError
from stage_twin.emulators.tracker import FLOOD_FACTOR, TrackerInstrument
from stage_twin.emulators.tracker_server import SaTextSender, TrackerServer
from tracker_bridge import tpi
from tracker_bridge.sa_text import SaFormat
from tracker_bridge.sources.emscon import EmsconSource
from tracker_bridge.sources.sa_text import SaTextSource
from tracker_bridge.tpi_packets import Answer, SingleMeasurement, StatusChange
from tracker_bridge.tpi_words import Command, Event, LengthUnit, PointStatus, ResultStatus

from ..patience import PATIENCE, wait

MS = 1_000_000


@contextlib.contextmanager
def serving(**options):
    server = TrackerServer(TrackerInstrument(**options))
    try:
        yield server
    finally:
        server.close()


@contextlib.contextmanager
def streaming(server, **options):
    samples = []
    source = EmsconSource(samples.append, '127.0.0.1', server.port, **options)
    source.samples = samples
    source.start()
    try:
        wait(lambda: source.connected)
        yield source
    finally:
        source.stop()
        assert not source.is_alive()


def push(server, numbers):
    for k in numbers:
        server.push(k * 10 * MS, (1e-3 * k, -0.5, 0.25))


class Client:
    """A TPI client that does what a test wants."""

    def __init__(self, server):
        self.socket = socket.create_connection(('127.0.0.1', server.port), timeout=PATIENCE)
        self.splitter = tpi.StreamSplitter()
        self.packets = []

    def next(self):
        while not self.packets:
            data = self.socket.recv(65536)
            if not data:
                return None
            self.packets += [tpi.decode(packet) for packet in self.splitter.feed(data)]
        return self.packets.pop(0)

    def ask(self, command, *arguments):
        self.socket.sendall(tpi.encode_command(command, *arguments))
        while True:
            packet = self.next()
            if isinstance(packet, Answer) and packet.command == command:
                return packet

    def close(self):
        self.socket.close()


def test_stream_arrives_complete_with_stamps_and_metres():
    with serving(clock_offset_ns=3_000 * MS) as server, streaming(server) as source:
        push(server, range(200))
        server.flush()
        wait(lambda: len(source.samples) == 200)
        for k, sample in enumerate(source.samples):
            assert sample.source_ns == k * 10 * MS + 3_000 * MS
            assert sample.point == pytest.approx((1e-3 * k, -0.5, 0.25), abs=1e-12)
            assert sample.status == 0


def test_flush_leaves_nothing_unsent_and_points_share_packets():
    with serving(packet_points=10) as server:
        client = Client(server)
        client.ask(Command.INITIALIZE)
        client.ask(Command.SET_MEASUREMENT_MODE, 1)
        assert client.ask(Command.START_MEASUREMENT).status == 0
        push(server, range(20))
        server.flush()
        assert not any(server.instrument.outbox(n) for n in list(server._clients.values()))
        assert [len(client.next().points) for _ in range(2)] == [10, 10]
        client.close()


def test_the_public_clients_sequence_is_answered():
    with serving() as server:
        client = Client(server)
        assert client.ask(Command.START_MEASUREMENT).status == ResultStatus.NOT_INITIALISED
        sequence = [
            (Command.SET_UNITS, 1, 0, 0, 0, 0),
            (Command.INITIALIZE,),
            (Command.SET_MEASUREMENT_MODE, 1),
            (Command.SET_CONTINUOUS_TIME_MODE_PARAMS, 20, 3, 0, 0),
            (Command.SET_REFLECTOR, 1),
            (Command.GO_BIRD_BATH,),
            (Command.SET_STATION_ORIENTATION,),
            (Command.SET_TRANSFORMATION,),
            (Command.SET_COORDINATE_SYSTEM_TYPE, 0),
            (Command.SET_SYSTEM_SETTINGS, 1, 0, 0, 1, 1, 0, 0, 0, 0),
            (Command.START_MEASUREMENT,),
        ]
        for command in sequence:
            assert client.ask(*command).status == ResultStatus.OK
        assert client.ask(Command.START_MEASUREMENT).status == ResultStatus.BUSY
        assert len(client.ask(Command.GET_SYSTEM_STATUS).payload) == 40
        assert len(client.ask(Command.GET_REFLECTORS).payload) == 84
        assert client.ask(999).status == ResultStatus.NOT_IMPLEMENTED
        wrong = client.ask(Command.SET_UNITS, 99, 0, 0, 0, 0)
        assert wrong.status == ResultStatus.WRONG_PARAMETER
        # Every 20 ms of the plant's 10 ms, three points, in millimetres.
        push(server, range(10))
        for k in (0, 2, 4):
            packet = client.next()
            assert packet.times_ns().tolist() == [k * 10 * MS]
            assert packet.points['values'][0].tolist() == pytest.approx([k, -500.0, 250.0])
        assert client.next() == StatusChange(Event.COUNT_REACHED)
        client.close()


def test_stationary_mode_gives_one_point():
    with serving() as server:
        client = Client(server)
        client.ask(Command.INITIALIZE)
        client.ask(Command.START_MEASUREMENT)
        push(server, range(3, 6))
        single = client.next()
        assert isinstance(single, SingleMeasurement)
        assert single.values == pytest.approx((3e-3, -0.5, 0.25))
        client.ask(Command.STOP_MEASUREMENT)
        assert client.packets == []
        client.close()


def test_beam_lost_and_found():
    with serving() as server, streaming(server) as source:
        push(server, range(5))
        server.set_fault('beam_lost')
        push(server, range(5, 20))
        wait(lambda: 'beam lost' in source.trouble and len(source.samples) == 6)
        assert source.samples[-1].status == PointStatus.PRISM_ERROR
        server.set_fault('none')
        push(server, range(20, 25))
        wait(lambda: len(source.samples) == 11)
        assert source.trouble == ''
        assert {s.status for s in source.samples[6:]} == {0}


@pytest.mark.parametrize(
    ('fault', 'order'),
    [
        ('duplicate', [0, 0, 1, 1, 2, 2, 3, 3]),
        ('out_of_order', [1, 0, 3, 2]),
        ('time_jump', [500, 501, 502, 503]),
    ],
)
def test_faults_of_the_order_and_the_clock_reach_the_bridge(fault, order):
    with serving() as server, streaming(server) as source:
        server.set_fault(fault)
        push(server, range(4))
        wait(lambda: len(source.samples) == len(order))
        assert [s.source_ns // (10 * MS) for s in source.samples] == order


def test_stall_and_flood():
    with serving() as server, streaming(server) as source:
        server.set_fault('stall')
        push(server, range(50))
        server.set_fault('flood')
        push(server, range(50, 150))
        wait(lambda: len(source.samples) == 100 * FLOOD_FACTOR)
        stamps = [s.source_ns for s in source.samples]
        assert {b - a for a, b in zip(stamps, stamps[1:], strict=False)} == {MS}


def test_dropped_connection_and_restarted_server_are_found_again():
    with serving() as server, streaming(server) as source:
        push(server, range(5))
        wait(lambda: len(source.samples) == 5)
        server.set_fault('drop_clients')
        wait(lambda: not source.connected or source.counters.get('reconnects'))
        wait(lambda: source.connected)
        push(server, range(5, 8))
        wait(lambda: len(source.samples) == 8)
        port = server.port
        server.close()
        wait(lambda: not source.connected)
        wait(lambda: f'127.0.0.1:{port}' in source.trouble and 'check' in source.trouble)
        again = TrackerServer(TrackerInstrument(), port)
        try:
            wait(lambda: source.connected)
            push(again, range(8, 10))
            wait(lambda: len(source.samples) == 10)
        finally:
            again.close()


def test_several_clients_and_a_foreign_change_of_units():
    with serving() as server, streaming(server) as source:
        source._ready -= 10.0
        other = Client(server)
        push(server, range(3))
        wait(lambda: len(source.samples) == 3)
        other.ask(Command.SET_UNITS, LengthUnit.INCH, 0, 0, 0, 0)
        # The source must not read inches as metres: it connects and sets its units again.
        wait(lambda: source.counters.get('reconnects') and source.connected)
        push(server, range(3, 6))
        wait(lambda: len(source.samples) == 6)
        assert source.samples[-1].point == pytest.approx((5e-3, -0.5, 0.25))
        wait(lambda: server.clients == 2)
        other.close()
        wait(lambda: server.clients == 1)


def test_a_client_that_sends_garbage_or_half_a_packet_harms_nobody():
    with serving() as server, streaming(server) as source:
        garbage = Client(server)
        garbage.socket.sendall(b'GET / HTTP/1.0\r\n\r\n' * 10)
        assert garbage.next() is None
        garbage.close()
        half = Client(server)
        half.socket.sendall(struct.pack('<ii', 32, 0))
        half.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))
        half.close()
        push(server, range(10))
        server.flush()
        wait(lambda: len(source.samples) == 10)


def test_a_client_that_reads_nothing_is_dropped_and_time_goes_on(monkeypatch):
    monkeypatch.setattr('stage_twin.emulators.tracker_server.HANG_LIMIT', 0.2)
    with serving(packet_points=1000) as server:
        client = Client.__new__(Client)
        client.splitter, client.packets = tpi.StreamSplitter(), []
        client.socket = socket.socket()
        client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.socket.settimeout(PATIENCE)
        client.socket.connect(('127.0.0.1', server.port))
        client.ask(Command.INITIALIZE)
        client.ask(Command.SET_MEASUREMENT_MODE, 1)
        client.ask(Command.START_MEASUREMENT)
        for first in range(0, 60_000, 1000):
            with server._lock:
                for k in range(first, first + 1000):
                    server.instrument.sample(k * MS, (0.0, 0.0, 0.0))
            server.flush()
            if server.clients == 0:
                break
        assert server.clients == 0 and server.dropped_clients == 1
        client.close()


def test_nobody_at_the_port_names_it_and_the_remedy():
    port = free_port()
    source = EmsconSource(lambda _: None, '127.0.0.1', port)
    source.start()
    try:
        wait(lambda: source.trouble)
        assert f'127.0.0.1:{port}' in source.trouble
        assert 'parameters host and port' in source.trouble
        assert source.is_alive() and not source.connected
    finally:
        source.stop()


def test_a_server_that_is_no_tracker_is_said_to_be_none():
    with socket.create_server(('127.0.0.1', 0)) as server:
        source = EmsconSource(lambda _: None, '127.0.0.1', server.getsockname()[1])
        source.start()
        try:
            connection, _ = server.accept()
            connection.sendall(b'SSH-2.0-OpenSSH_9.2\r\n')
            wait(lambda: 'no TPI packet' in source.trouble)
            connection.close()
        finally:
            source.stop()


def test_a_taken_port_is_one_clear_error():
    with serving() as server, pytest.raises(StageError, match='tracker_port'):
        TrackerServer(TrackerInstrument(), server.port)


@pytest.mark.parametrize('form', ['watch_window', 'script'])
def test_text_datagrams(form):
    samples = []
    source = SaTextSource(samples.append, '127.0.0.1', 0, SaFormat())
    sender = SaTextSender(source.port, form, decimals=6)
    source.start()
    try:
        assert 'no datagrams' in source.trouble
        for k in range(20):
            sender.push(k * 10 * MS, (1e-3 * k, -0.5, 0.25))
            wait(lambda k=k: len(samples) == k + 1)
        assert samples[7].point == pytest.approx((7e-3, -0.5, 0.25), abs=1e-9)
        assert samples[7].source_ns == (70 * MS if form == 'script' else None)
        sender.set_fault('stall')
        sender.push(0, (0.0, 0.0, 0.0))
        stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        stranger.sendto(b'nonsense', ('127.0.0.1', source.port))
        stranger.close()
        wait(lambda: source.counters.get('refused_datagrams') == 1)
        assert 'no X, Y, Z' in source.trouble
        assert len(samples) == 20
    finally:
        source.stop()
        sender.close()


def test_text_source_on_a_foreign_address_is_refused():
    with pytest.raises(StageError, match='192.0.2.1.*address of this machine'):
        SaTextSource(lambda _: None, '192.0.2.1', 0, SaFormat())
