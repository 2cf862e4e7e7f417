"""A serial line between a host and the emulated Zaber chain that takes the time of its bits."""

from __future__ import annotations

import os
import pty
import select
import threading
import time
import tty

#: Start bit, eight data bits, stop bit.
BITS = 10


class PacedWire:
    """A pseudo-terminal `port` whose lines reach `device`, and come back, after their time.

    A line arrives when its last byte would. Both directions run at once, as on a real line.

    Attributes
    ----------
    lines
        Of the exchange since the list was cleared: whether the host sent it, and its bytes.
    """

    def __init__(self, device: str, baud: int) -> None:
        self.byte_time = BITS / baud
        self.lines: list[tuple[bool, int]] = []
        self._master, self._slave = pty.openpty()
        self._device = os.open(device, os.O_RDWR | os.O_NOCTTY)
        for descriptor in (self._master, self._slave):
            tty.setraw(descriptor)
        self.port = os.ttyname(self._slave)
        self._ended = threading.Event()
        self._threads = [
            threading.Thread(target=self._carry, args=way, daemon=True)
            for way in ((self._master, self._device, True), (self._device, self._master, False))
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """End both threads and close the terminal."""
        self._ended.set()
        for thread in self._threads:
            thread.join()
        for descriptor in (self._master, self._slave, self._device):
            os.close(descriptor)

    def _carry(self, source: int, sink: int, outward: bool) -> None:
        """Pass whole lines on, each after the time of its bytes."""
        rest, free = b'', 0.0
        while not self._ended.is_set():
            if not select.select([source], [], [], 0.05)[0]:
                continue
            rest += os.read(source, 4096)
            came = time.monotonic()
            *whole, rest = rest.split(b'\n')
            for line in whole:
                free = max(free, came) + (len(line) + 1) * self.byte_time
                time.sleep(max(0.0, free - time.monotonic()))
                self.lines.append((outward, len(line) + 1))
                os.write(sink, line + b'\n')

    def own_time(self) -> float:
        """Least time of the exchange in `lines` with devices that answer at once [s].

        A reply begins when its request has come and the reply before has gone.
        """
        sent = [size for outward, size in self.lines if outward]
        replies = [size for outward, size in self.lines if not outward]
        request = reply = 0.0
        for out, back in zip(sent, replies, strict=True):
            request += out * self.byte_time
            reply = max(request, reply) + back * self.byte_time
        return reply
