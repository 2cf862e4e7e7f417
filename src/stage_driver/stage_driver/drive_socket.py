"""The driver's end of the drive link: one UDP socket on this machine."""

from __future__ import annotations

import math
import socket
import struct
import time

from stage_core import drive_link
from stage_core.errors import StageError
from stage_core.ownership import Ownership, address

#: While the drive is silent, HELLO goes out this often [s].
HELLO_PERIOD = 1.0


class DriveSocket:
    """Sends HELLO and FORCE, receives ENCODER; garbage is dropped.

    Raises
    ------
    StageError
        If another driver has the drive, or the host is unknown.
    """

    def __init__(self, host: str, port: int) -> None:
        wire = f'drive {address(host, port)}'
        self._owned = Ownership(wire, 'stage_driver', 'give this driver another drive_port')
        try:
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            # Connected: datagrams of anybody but the drive are dropped by the kernel.
            self._socket.connect((host, port))
        except OSError as error:
            self._owned.close()
            raise StageError(
                f'cannot reach the drive at {host}:{port}: {error.strerror or error}: check host '
                'and port'
            ) from error
        # A timeout of the kernel's, not of Python's: one system call per datagram.
        self._timeout = -1.0
        self.connected = False
        self.lockstep = False
        self._heard = self._hello_sent = 0.0
        self._pending: drive_link.Datagram | None = None

    def close(self) -> None:
        """Close the socket and give the drive back."""
        self._socket.close()
        self._owned.close()

    def silence(self) -> float:
        """Seconds of wall time since the last datagram of the drive."""
        return time.monotonic() - self._heard

    def send(self, packet: bytes) -> None:
        """Send a datagram; a drive that is not there is found by its silence."""
        try:
            self._socket.send(packet)
        except OSError:
            # Connection refused: nobody listens at the moment.
            return

    def receive(self, timeout: float) -> drive_link.Datagram | None:
        """Next ENCODER datagram, or None after `timeout` [s]; says HELLO where it is silent."""
        if self._pending is not None:
            datagram, self._pending = self._pending, None
            return datagram
        self._say_hello()
        if timeout != self._timeout:
            self._timeout = timeout
            seconds, rest = divmod(timeout, 1.0)
            limit = struct.pack('ll', int(seconds), int(1e6 * rest))
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)
        return self._read()

    def newer_waits(self) -> bool:
        """Whether the drive has sent another datagram already; `receive` returns it next."""
        if self._pending is None:
            self._pending = self._read(socket.MSG_DONTWAIT)
        return self._pending is not None

    def _say_hello(self) -> None:
        now = time.monotonic()
        if now - self._heard > HELLO_PERIOD and now - self._hello_sent > HELLO_PERIOD:
            self._hello_sent = now
            self.send(drive_link.encode_hello())

    def peek_reset(self) -> bool:
        """Whether the drive was restarted while a tick waits; repeats of that tick are dropped."""
        self._say_hello()
        while (datagram := self._read(socket.MSG_DONTWAIT)) is not None:
            if datagram.flags & drive_link.RESET or not datagram.flags & drive_link.REPEATED:
                self._pending = datagram
                return True
        return False

    def _read(self, flags: int = 0) -> drive_link.Datagram | None:
        try:
            data = self._socket.recv(drive_link.MAX_DATAGRAM, flags)
        except BlockingIOError:
            return None
        except OSError:
            # Connection refused comes at once: waiting keeps a missing drive from a busy loop.
            time.sleep(0.02)
            return None
        try:
            datagram = drive_link.decode(data)
        except StageError:
            return None
        if datagram.kind != drive_link.ENCODER or not all(map(math.isfinite, datagram.values)):
            return None
        self._heard = time.monotonic()
        self.lockstep = bool(datagram.flags & drive_link.LOCKSTEP)
        return datagram
