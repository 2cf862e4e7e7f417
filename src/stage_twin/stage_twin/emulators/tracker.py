"""A laser tracker that speaks emScon TPI, fed with points of the plant: the protocol, no sockets.

`TrackerInstrument` is pure: bytes of clients in, bytes for clients out, time only from the
samples it is given. `stage_twin.emulators.tracker_server` puts it on TCP.
"""

from __future__ import annotations

import itertools
import struct
from dataclasses import dataclass, field

import numpy as np

from stage_core.errors import StageError
from tracker_bridge import tpi
from tracker_bridge.tpi_packets import (
    POINT,
    CommandPacket,
    MultiMeasurement,
    SingleMeasurement,
)
from tracker_bridge.tpi_words import (
    CARTESIAN_RIGHT_HANDED,
    METRES_PER_UNIT,
    Command,
    Event,
    LengthUnit,
    PointStatus,
    ResultStatus,
)

Point = tuple[float, float, float]
FAULTS = ('none', 'beam_lost', 'stall', 'duplicate', 'out_of_order', 'time_jump', 'flood')
FLOOD_FACTOR = 10
TIME_JUMP_NS = 5_000_000_000
#: What the weather station reports [degC, mbar, %].
WEATHER = (20.0, 1013.25, 45.0)


@dataclass
class _Client:
    """What the tracker keeps for one connection."""

    splitter: tpi.StreamSplitter = field(default_factory=tpi.StreamSplitter)
    outbox: bytearray = field(default_factory=bytearray)
    measuring: bool = False
    sent: int = 0
    # The next point of the separation's grid is due then; the newest point was seen then.
    due_ns: int | None = None
    newest_ns: int | None = None
    pending: list[tuple[int, Point, int]] = field(default_factory=list)


class TrackerInstrument:
    """State of the tracker, shared by its clients as on the real controller.

    Parameters
    ----------
    clock_offset_ns
        Added to the plant's time to give the controller's clock, whose epoch nobody knows [ns].
    packet_points
        Points that are gathered into one packet.
    """

    def __init__(self, clock_offset_ns: int = 0, packet_points: int = 1) -> None:
        self.clock_offset_ns = clock_offset_ns
        self.packet_points = packet_points
        self.fault = 'none'
        self._clients: dict[int, _Client] = {}
        self._identifiers = itertools.count(1)
        self._units: tuple[int, ...] = (0, 0, 0, 0, 0)
        self._initialised = False
        self._mode = 0
        self._separation_ns = 0
        self._count = 0
        self._held: tuple[int, Point, int] | None = None
        self._jump_ns = 0

    # Clients

    def connect(self) -> int:
        """Add a client; return its number."""
        number = next(self._identifiers)
        self._clients[number] = _Client()
        return number

    def disconnect(self, client: int) -> None:
        """Forget a client."""
        self._clients.pop(client, None)

    def outbox(self, client: int) -> bytearray:
        """Return the bytes waiting for a client; the caller removes what it has sent."""
        return self._clients[client].outbox

    def receive(self, client: int, data: bytes) -> None:
        """Take bytes of a client and put the answers into the outboxes.

        Raises
        ------
        tracker_bridge.tpi.TpiError
            For bytes that are no commands: the connection must be closed.
        """
        for packet in self._clients[client].splitter.feed(data):
            self._execute(client, tpi.decode_command(packet))

    def broadcast(self, event: int, but: int | None = None) -> None:
        """Send an event to every client but one."""
        for number, client in self._clients.items():
            if number != but:
                client.outbox += tpi.encode_status_change(event)

    def set_fault(self, fault: str) -> None:
        """Switch a fault on, or all of them off with ``none`` (see `FAULTS`).

        ``beam_lost`` sends one point with a prism error and the event "not ready", then nothing;
        ``stall`` sends nothing at all; ``duplicate`` sends each point twice; ``out_of_order``
        exchanges every two points; ``time_jump`` adds 5 s to the controller's clock once;
        ``flood`` sends ten points for each.
        """
        if fault not in FAULTS:
            raise StageError(f'unknown fault {fault}: use one of {", ".join(FAULTS)}')
        if fault == self.fault:
            return
        if self.fault == 'beam_lost':
            self.broadcast(Event.MEASUREMENT_READY)
        if fault == 'time_jump':
            self._jump_ns += TIME_JUMP_NS
        if fault == 'beam_lost':
            self.broadcast(Event.MEASUREMENT_NOT_READY)
        self._held = None
        self.fault = fault

    # Commands

    def _execute(self, number: int, command: CommandPacket) -> None:
        client = self._clients[number]
        status = ResultStatus.OK
        payload = b''
        event: int | None = None
        arguments = command.arguments
        code = command.command
        if code == Command.GET_SYSTEM_STATUS:
            payload = struct.pack('<10i', *([0] * 10))
        elif code == Command.GET_REFLECTORS:
            client.outbox += tpi.encode_reflectors(1, 1, 0.0, 'RRR 1.5in')
            return
        elif code == Command.SET_UNITS:
            if len(arguments) == 5 and arguments[0] in METRES_PER_UNIT:
                event = Event.UNITS_CHANGED if arguments != self._units else None
                self._units = arguments
            else:
                status = ResultStatus.WRONG_PARAMETER
        elif code == Command.INITIALIZE:
            self._initialised = True
        elif code == Command.SET_MEASUREMENT_MODE:
            status = self._one_of(arguments, (0, 1))
            self._mode = arguments[0] if status == 0 else self._mode
        elif code == Command.SET_COORDINATE_SYSTEM_TYPE:
            status = self._one_of(arguments, (CARTESIAN_RIGHT_HANDED,))
        elif code == Command.SET_CONTINUOUS_TIME_MODE_PARAMS:
            if len(arguments) == 4 and arguments[0] >= 0 and arguments[1] >= 0:
                self._separation_ns, self._count = arguments[0] * 1_000_000, arguments[1]
            else:
                status = ResultStatus.WRONG_PARAMETER
        elif code == Command.SET_REFLECTOR:
            status = self._one_of(arguments, (1,))
        elif code == Command.START_MEASUREMENT:
            status = self._start(client)
        elif code == Command.STOP_MEASUREMENT:
            client.measuring = False
            self._emit(client)
        elif code not in (
            Command.SET_SYSTEM_SETTINGS,
            Command.SET_STATION_ORIENTATION,
            Command.SET_TRANSFORMATION,
            Command.GO_BIRD_BATH,
            Command.FIND_REFLECTOR,
        ):
            status = ResultStatus.NOT_IMPLEMENTED
        client.outbox += tpi.encode_answer(code, status, payload)
        if event is not None:
            self.broadcast(event, but=number)

    @staticmethod
    def _one_of(arguments: tuple[int, ...], allowed: tuple[int, ...]) -> ResultStatus:
        if len(arguments) == 1 and arguments[0] in allowed:
            return ResultStatus.OK
        return ResultStatus.WRONG_PARAMETER

    def _start(self, client: _Client) -> ResultStatus:
        if not self._initialised:
            return ResultStatus.NOT_INITIALISED
        if client.measuring:
            return ResultStatus.BUSY
        client.measuring = True
        client.sent = 0
        client.due_ns = client.newest_ns = None
        client.pending.clear()
        return ResultStatus.OK

    # Points

    def sample(self, time_ns: int, point: Point, status: int = 0) -> None:
        """Hand over one point of the plant: its time [ns] and coordinates [m]."""
        controller_ns = time_ns + self.clock_offset_ns + self._jump_ns
        record = (controller_ns, point, status)
        if self.fault == 'stall':
            return
        if self.fault == 'beam_lost':
            if self._held is None:
                self._held = record
                self._send((controller_ns, point, PointStatus.PRISM_ERROR))
            return
        if self.fault == 'out_of_order':
            if self._held is None:
                self._held = record
            else:
                self._send(record)
                self._send(self._held)
                self._held = None
            return
        self._send(record)
        if self.fault == 'duplicate':
            self._send(record, again=True)
        elif self.fault == 'flood':
            for index in range(1, FLOOD_FACTOR):
                self._send((controller_ns + index * 1_000_000, point, status), again=True)

    def _send(self, record: tuple[int, Point, int], again: bool = False) -> None:
        for client in self._clients.values():
            if not client.measuring:
                continue
            if not again and not self._due(client, record[0]):
                continue
            client.pending.append(record)
            client.sent += 1
            complete = self._count and client.sent >= self._count
            if self._mode == 0 or complete or len(client.pending) >= self.packet_points:
                self._emit(client)
            if self._mode == 0 or complete:
                client.measuring = False
                if complete:
                    client.outbox += tpi.encode_status_change(Event.COUNT_REACHED)

    def _due(self, client: _Client, time_ns: int) -> bool:
        """Return whether a point belongs on the client's grid; a point out of order does."""
        separation = self._separation_ns
        if client.newest_ns is not None and time_ns <= client.newest_ns:
            return True
        client.newest_ns = time_ns
        # A quarter of slack: the plant's instants need not lie on the grid.
        if client.due_ns is not None and time_ns < client.due_ns - separation // 4:
            return False
        client.due_ns = (client.due_ns or time_ns) + separation
        if client.due_ns <= time_ns:
            client.due_ns = time_ns + separation
        return True

    def _emit(self, client: _Client) -> None:
        """Put the gathered points of a client into its outbox as one packet."""
        if not client.pending:
            return
        scale = 1.0 / METRES_PER_UNIT[LengthUnit(self._units[0])]
        points = np.zeros(len(client.pending), POINT)
        for row, (time_ns, point, status) in enumerate(client.pending):
            microseconds = (time_ns + 500) // 1000
            points[row] = (
                status,
                microseconds // 1_000_000,
                microseconds % 1_000_000,
                [value * scale for value in point],
            )
        client.pending.clear()
        if self._mode == 0:
            x, y, z = points['values'][-1]
            single = SingleMeasurement(0, 0, 0, (x, y, z), (0.0, 0.0, 0.0), 0.0, *WEATHER)
            client.outbox += tpi.encode_single(single)
            return
        client.outbox += tpi.encode_multi(MultiMeasurement(0, self._mode, 0, *WEATHER, points))
