"""TPI client: connects, sets the tracker up, streams, and connects again when it breaks."""

from __future__ import annotations

import contextlib
import socket
import time

from stage_core.errors import StageError
from tracker_bridge import tpi
from tracker_bridge.samples import Sample
from tracker_bridge.sources.base import POLL, Deliver, Source
from tracker_bridge.tpi_packets import (
    Answer,
    ErrorPacket,
    MultiMeasurement,
    ServerPacket,
    StatusChange,
)
from tracker_bridge.tpi_words import (
    CARTESIAN_RIGHT_HANDED,
    CONTINUOUS_TIME_MODE,
    Command,
    Event,
    LengthUnit,
    PointStatus,
    ResultStatus,
)

CONNECT_TIMEOUT = 2.0
ANSWER_TIMEOUT = 10.0
INITIALIZE_TIMEOUT = 300.0
FIRST_BACKOFF = 0.2
LONGEST_BACKOFF = 2.0
# Events this soon after the set-up may be echoes of its own commands [s].
ECHO_TIME = 1.0
# A tracker whose power went says nothing more: asked after 5 s of silence, lost after 5 s more.
KEEPALIVE = {socket.TCP_KEEPIDLE: 5, socket.TCP_KEEPINTVL: 1, socket.TCP_KEEPCNT: 5}
# Another client has changed what the numbers mean: they must not be read any more.
SPOILING = {
    Event.UNITS_CHANGED: 'the units',
    Event.COORDINATE_SYSTEM_CHANGED: 'the coordinate system',
    Event.TRANSFORMATION_CHANGED: 'the transformation',
}
NOT_MEASURING = (Event.MEASUREMENT_NOT_READY, Event.COUNT_REACHED)


class TrackerLost(StageError):
    """The connection cannot be used any more; the source opens a new one."""


class EmsconSource(Source):
    """Stream of continuous-time measurements over TPI, in metres.

    The tracker is initialised only when it says that it is not: initialising moves its head.

    Parameters
    ----------
    host, port
        The tracker's controller.
    separation
        Time between two points [s], whole milliseconds.
    """

    def __init__(self, deliver: Deliver, host: str, port: int, separation: float = 0.01) -> None:
        super().__init__(deliver)
        self.address = (host, port)
        self._separation_ms = max(1, round(separation * 1000))
        self._socket = socket.socket()
        self._splitter = tpi.StreamSplitter()
        self._ready = 0.0
        self._suspected = False
        self._receive_ns = self._opened_ns = 0

    def run(self) -> None:
        """Connect and stream until `stop`."""
        backoff = FIRST_BACKOFF
        while not self.ended.is_set():
            try:
                self._connect()
                self._set_up()
                self._ready = time.monotonic()
                self.connected, self.trouble = True, ''
                backoff = FIRST_BACKOFF
                while not self.ended.is_set():
                    for packet in self._receive():
                        self._take(packet)
            except (OSError, UnicodeError, StageError) as error:
                self.trouble = self._explain(error)
            finally:
                self._leave()
            if not self.ended.wait(backoff):
                self.count('reconnects')
            backoff = min(2.0 * backoff, LONGEST_BACKOFF)

    def _leave(self) -> None:
        if self.connected and self.ended.is_set():
            with contextlib.suppress(OSError):
                self._socket.sendall(tpi.encode_command(Command.STOP_MEASUREMENT))
        self.connected = False
        self._socket.close()

    def _explain(self, error: Exception) -> str:
        host, port = self.address
        if isinstance(error, StageError):
            return f'tracker at {host}:{port}: {error}'
        reason = getattr(error, 'strerror', None) or str(error) or type(error).__name__
        return (
            f'no tracker at {host}:{port} ({reason}): check that the tracker controller is on and '
            'the parameters host and port'
        )

    def _connect(self) -> None:
        self._opened_ns = time.time_ns()
        self._socket = socket.create_connection(self.address, timeout=CONNECT_TIMEOUT)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, number in KEEPALIVE.items():
            self._socket.setsockopt(socket.IPPROTO_TCP, option, number)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.settimeout(POLL)
        self._splitter = tpi.StreamSplitter()

    def _configure(self) -> None:
        # Metres, radians, degrees Celsius, millibar.
        self._command(Command.SET_UNITS, LengthUnit.METRE, 0, 0, 0, 0)
        self._command(Command.SET_MEASUREMENT_MODE, CONTINUOUS_TIME_MODE)
        self._command(Command.SET_CONTINUOUS_TIME_MODE_PARAMS, self._separation_ms, 0, 0, 0)
        self._command(Command.SET_COORDINATE_SYSTEM_TYPE, CARTESIAN_RIGHT_HANDED)
        # Keep the last position, send events unsolicited; no transformation is applied.
        self._command(Command.SET_SYSTEM_SETTINGS, 1, 0, 0, 1, 1, 0, 0, 0, 0)

    def _set_up(self) -> None:
        self._configure()
        status = self._answer(Command.START_MEASUREMENT)
        if status == ResultStatus.NOT_INITIALISED:
            self._command(Command.INITIALIZE, timeout=INITIALIZE_TIMEOUT)
            # It takes minutes, in which another client may have set the tracker up.
            self._configure()
            status = self._answer(Command.START_MEASUREMENT)
        if status == ResultStatus.BUSY:
            self._command(Command.STOP_MEASUREMENT)
            status = self._answer(Command.START_MEASUREMENT)
        if status != ResultStatus.OK:
            raise TrackerLost(f'StartMeasurement was refused with status {status}')

    def _command(self, command: Command, *arguments: int, timeout: float = ANSWER_TIMEOUT) -> None:
        status = self._answer(command, *arguments, timeout=timeout)
        if status != ResultStatus.OK:
            raise TrackerLost(
                f'command {command:d} was refused with status {status}: see the tracker controller'
            )

    def _answer(self, command: Command, *arguments: int, timeout: float = ANSWER_TIMEOUT) -> int:
        """Send a command and return the status of its answer; other packets are skipped."""
        self._socket.sendall(tpi.encode_command(command, *arguments))
        deadline = time.monotonic() + timeout
        status: int | None = None
        while status is None and not self.ended.is_set():
            for received in self._receive():
                if isinstance(received, (Answer, ErrorPacket)) and received.command == command:
                    status = received.status
                elif status is not None:
                    # Points that follow the answer to StartMeasurement at once.
                    self._take(received)
            if status is None and time.monotonic() > deadline:
                raise TrackerLost(
                    f'command {command:d} was not answered in {timeout:.0f} s: check that the '
                    "port is the tracker's TPI port"
                )
        if status is None:
            raise TrackerLost('stopped')
        return status

    def _receive(self) -> list[ServerPacket]:
        try:
            data = self._socket.recv(65536)
        except TimeoutError:
            return []
        self._receive_ns = time.time_ns()
        if not data:
            raise TrackerLost('the tracker closed the connection: check that it is on')
        return [tpi.decode(packet) for packet in self._splitter.feed(data)]

    def _take(self, packet: ServerPacket) -> None:
        if isinstance(packet, MultiMeasurement):
            self._take_points(packet)
        elif isinstance(packet, StatusChange):
            self._take_event(packet.event)
        elif isinstance(packet, ErrorPacket):
            self.count('errors')
            self.trouble = f'tracker error {packet.status} of command {packet.command}'

    def _take_points(self, packet: MultiMeasurement) -> None:
        if packet.status != ResultStatus.OK:
            self.count('bad_packets')
            return
        times = packet.times_ns().tolist()
        statuses = packet.points['status'].tolist()
        if PointStatus.OK in statuses:
            self.trouble = ''
        values = packet.points['values'].tolist()
        for time_ns, status, (x, y, z) in zip(times, statuses, values, strict=True):
            self.deliver(
                Sample((x, y, z), self._receive_ns, time_ns, status, opened_ns=self._opened_ns)
            )

    def _take_event(self, event: int) -> None:
        self.count(f'event_{event}')
        if event in SPOILING:
            # What also follows the second set-up at once is its echo.
            soon = time.monotonic() - self._ready <= ECHO_TIME
            echo, self._suspected = soon and self._suspected, soon
            if not echo:
                raise TrackerLost(
                    f'another client changed {SPOILING[Event(event)]}: setting the tracker up anew'
                )
        if event == Event.SERVER_CLOSING:
            raise TrackerLost('the tracker server closes: start it again')
        if event in NOT_MEASURING:
            self.trouble = 'the tracker does not measure (beam lost?): put the reflector back'
        elif event == Event.MEASUREMENT_READY:
            self.trouble = ''
