"""The emulated tracker on loopback: TPI over TCP, or SpatialAnalyzer text over UDP."""

from __future__ import annotations

import contextlib
import select
import selectors
import socket
import threading
import time

from stage_core.errors import StageError
from stage_twin.emulators.tracker import Point, TrackerInstrument
from tracker_bridge.sa_text import format_script_line
from tracker_bridge.tpi_packets import TpiError
from tracker_bridge.tpi_words import Event

LOOPBACK = '127.0.0.1'
# A client that leaves this much unread has died: it is dropped, memory stays bounded.
MAXIMUM_OUTBOX = 1 << 20
HANG_LIMIT = 5.0


class TrackerServer:
    """Serve a `TrackerInstrument` to any number of TCP clients from one thread.

    Parameters
    ----------
    instrument
        The protocol.
    port
        TCP port on 127.0.0.1; 0 takes a free one (see attribute `port`).

    Raises
    ------
    StageError
        When the port is taken.
    """

    def __init__(self, instrument: TrackerInstrument, port: int = 0) -> None:
        self.instrument = instrument
        self.dropped_clients = 0
        self._lock = threading.Lock()
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind((LOOPBACK, port))
        except OSError as error:
            self._listener.close()
            raise StageError(
                f'TCP port {port} for the tracker is taken ({error.strerror}): set tracker_port'
            ) from error
        self._listener.listen()
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._wake, self._woken = socket.socketpair()
        self._wake.setblocking(False)
        self._woken.setblocking(False)
        self._clients: dict[socket.socket, int] = {}
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._selector.register(self._woken, selectors.EVENT_READ)
        self._running = True
        self._thread = threading.Thread(target=self._serve, name='tracker_server', daemon=True)
        self._thread.start()

    @property
    def clients(self) -> int:
        """Return the number of connected clients."""
        return len(self._clients)

    def push(self, time_ns: int, point: Point) -> None:
        """Hand over a point of the plant and send what the sockets take at once."""
        with self._lock:
            self.instrument.sample(time_ns, point)
            # Sent here and not by the server's thread: a change of threads costs milliseconds.
            unsent = [client for client in list(self._clients) if not self._send(client)]
        if unsent:
            self._notify()

    def set_fault(self, fault: str) -> None:
        """Switch a fault of the instrument; ``drop_clients`` closes every connection."""
        with self._lock:
            if fault == 'drop_clients':
                for client in list(self._clients):
                    self._drop(client)
            else:
                self.instrument.set_fault(fault)
        self._notify()

    def flush(self) -> None:
        """Return when every point pushed has been written to its socket.

        A client that reads nothing for 5 s is dropped, so that a hung reader cannot stop time.
        """
        deadline = time.monotonic() + HANG_LIMIT
        while True:
            with self._lock:
                waiting = [client for client in list(self._clients) if not self._send(client)]
                if waiting and time.monotonic() > deadline:
                    for client in waiting:
                        self._drop(client)
                    return
            if not waiting:
                return
            with contextlib.suppress(OSError, ValueError):
                select.select([], waiting, [], 0.1)

    def close(self) -> None:
        """Tell the clients that the server closes, and end; a second call does nothing."""
        with self._lock:
            if not self._running:
                return
            self._running = False
            self.instrument.broadcast(Event.SERVER_CLOSING)
            for client in list(self._clients):
                self._send(client)
        self._notify()
        self._thread.join(timeout=5.0)
        with self._lock:
            for client in list(self._clients):
                self._drop(client)
        self._selector.close()
        for end in (self._listener, self._wake, self._woken):
            end.close()

    def _notify(self) -> None:
        # A full pipe already wakes the thread.
        with contextlib.suppress(BlockingIOError):
            self._wake.send(b'\0')

    def _serve(self) -> None:
        while self._running:
            for key, events in self._selector.select(timeout=0.5):
                if key.fileobj is self._listener:
                    self._accept()
                elif key.fileobj is self._woken:
                    with contextlib.suppress(BlockingIOError):
                        self._woken.recv(4096)
                elif isinstance(key.fileobj, socket.socket) and events & selectors.EVENT_READ:
                    self._read(key.fileobj)
            with self._lock:
                for client in list(self._clients):
                    self._watch(client, unsent=not self._send(client))

    def _watch(self, client: socket.socket, unsent: bool) -> None:
        if client in self._clients:
            writing = selectors.EVENT_WRITE if unsent else 0
            self._selector.modify(client, selectors.EVENT_READ | writing)

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            client, _ = self._listener.accept()
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            # A reader that hangs shall be noticed before megabytes lie in the kernel.
            client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 17)
            with self._lock:
                self._clients[client] = self.instrument.connect()
                self._selector.register(client, selectors.EVENT_READ)

    def _read(self, client: socket.socket) -> None:
        with self._lock:
            if client not in self._clients:
                return
            try:
                data = client.recv(65536)
                if data:
                    self.instrument.receive(self._clients[client], data)
                    return
            except BlockingIOError:
                return
            except (OSError, TpiError):
                pass
            self._drop(client)

    def _send(self, client: socket.socket) -> bool:
        """Send what the socket takes; return whether nothing is left."""
        if client not in self._clients:
            return True
        outbox = self.instrument.outbox(self._clients[client])
        try:
            while outbox:
                del outbox[: client.send(outbox)]
        except BlockingIOError:
            if len(outbox) > MAXIMUM_OUTBOX:
                self._drop(client)
                return True
            return False
        except OSError:
            self._drop(client)
        return True

    def _drop(self, client: socket.socket) -> None:
        self.dropped_clients += 1
        self.instrument.disconnect(self._clients.pop(client))
        with contextlib.suppress(KeyError, ValueError):
            self._selector.unregister(client)
        client.close()


class SaTextSender:
    """Send every point as one UDP datagram, as SpatialAnalyzer does.

    Parameters
    ----------
    port
        Destination on 127.0.0.1.
    form
        ``watch_window`` (the form seen in public) or ``script`` (the project's line with a stamp).
    decimals
        Digits after the point in mm that the window displays.
    """

    def __init__(self, port: int, form: str = 'watch_window', decimals: int = 4) -> None:
        self._target = (LOOPBACK, port)
        self._form = form
        self._decimals = decimals
        self._sequence = 0
        self._muted = False
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def datagram(self, time_ns: int, point: Point) -> bytes:
        """Return the datagram of a point [m] at a time [ns]."""
        self._sequence += 1
        if self._form == 'script':
            return format_script_line(self._sequence, time_ns, point)
        digits = self._decimals
        fields = [
            f' {name}, {value * 1e3:{digits + 8}.{digits}f}, '
            for name, value in zip('XYZ', point, strict=True)
        ]
        return ('|' + '|'.join(fields) + '| Units: (mm) |').encode('ascii')

    def push(self, time_ns: int, point: Point) -> None:
        """Send a point; a receiver that is not there is no error."""
        if not self._muted:
            with contextlib.suppress(OSError):
                self._socket.sendto(self.datagram(time_ns, point), self._target)

    def set_fault(self, fault: str) -> None:
        """Fall silent for ``beam_lost`` and ``stall``; text has no other way to say it."""
        self._muted = fault in ('beam_lost', 'stall')

    def flush(self) -> None:
        """Do nothing: a datagram is written when it is pushed."""

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
