"""Server side of the drive link: the socket of the emulated drive, and its clock in real time."""

from __future__ import annotations

import select
import socket
import time
from dataclasses import dataclass

from stage_core import drive_link
from stage_core.errors import StageError

LOOPBACK = '127.0.0.1'


class DriveSocket:
    """UDP socket on 127.0.0.1 to one driver: the sender of the newest HELLO.

    Parameters
    ----------
    axes
        Number of axes; a force datagram with another number is refused.
    port
        0 takes a free one (see attribute `port`).

    Raises
    ------
    StageError
        When the port is taken.
    """

    def __init__(self, axes: int, port: int = drive_link.DEFAULT_PORT) -> None:
        self._axes = axes
        self._peer: tuple[str, int] | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((LOOPBACK, port))
        except OSError as error:
            self._socket.close()
            raise StageError(
                f'UDP port {port} for the drive link is taken ({error.strerror}): '
                'set drive_port here and in stage_driver'
            ) from error
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]
        self.refused = 0
        self.greeted = False

    @property
    def connected(self) -> bool:
        """Return whether a driver has said HELLO."""
        return self._peer is not None

    def send(
        self,
        tick: int,
        stamp: int,
        positions: tuple[float, ...],
        temperatures: tuple[float, ...],
        flags: int = 0,
    ) -> None:
        """Send encoder `tick` to the driver, if there is one."""
        if self._peer is None:
            return
        data = drive_link.encode_encoder(tick, stamp, positions, temperatures, flags)
        try:
            self._socket.sendto(data, self._peer)
        except OSError:
            # The driver has gone, or its buffer is full: the watchdog deals with its silence.
            self.refused += 1

    def receive(self) -> drive_link.Datagram | None:
        """Return the next force of the present driver, or None when none is waiting.

        A HELLO makes its sender the driver and sets `greeted`. Everything else is counted.
        """
        while True:
            try:
                data, sender = self._socket.recvfrom(2048)
            except BlockingIOError:
                return None
            except OSError:
                # ICMP "port unreachable" of an earlier send.
                continue
            try:
                datagram = drive_link.decode(data)
            except StageError:
                self.refused += 1
                continue
            if datagram.kind == drive_link.HELLO:
                self._peer = sender
                self.greeted = True
            elif (
                datagram.kind == drive_link.FORCE
                and sender == self._peer
                and len(datagram.values) == self._axes
                # A NaN would spoil the plant for good.
                and all(abs(value) < 1e9 for value in datagram.values)
            ):
                return datagram
            else:
                self.refused += 1

    def wait(self, timeout: float) -> bool:
        """Wait until a datagram has come; return whether one has."""
        return bool(select.select([self._socket], [], [], timeout)[0])

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


@dataclass
class Pacer:
    """Absolute deadlines of a periodic thread on the monotonic clock.

    A thread that lags is up to date again at twice the speed: those that follow its ticks must
    keep up with it.

    Attributes
    ----------
    longest_lag
        Lag that is caught up [s]. What exceeds it is lost: the deadlines move.
    missed
        Deadlines that had passed by more than one period when the thread came to them.
    pauses
        Times when deadlines have moved.
    worst
        Largest lateness since the start [s].
    """

    period: float
    longest_lag: float = 0.05
    deadline: float = 0.0
    missed: int = 0
    pauses: int = 0
    worst: float = 0.0
    _woke: float = 0.0

    def start(self) -> None:
        """Put the first deadline now."""
        self.deadline = self._woke = time.monotonic()

    def next(self) -> float:
        """Sleep until the next deadline and return it (monotonic clock) [s]."""
        self.deadline += self.period
        left = max(self.deadline, self._woke + 0.5 * self.period) - time.monotonic()
        if left > 0.0:
            time.sleep(left)
        self._woke = time.monotonic()
        late = self._woke - self.deadline
        self.worst = max(self.worst, late)
        if late > self.period:
            self.missed += 1
        self.let_go()
        return self.deadline

    def let_go(self) -> None:
        """Move the deadline where the thread lags by more than it catches up."""
        lost = time.monotonic() - self.deadline - self.longest_lag
        if lost > 0.0:
            self.pauses += 1
            self.deadline += lost
