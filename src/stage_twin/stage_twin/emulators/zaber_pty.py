"""The Zaber chain behind a pseudo-terminal: what a USB serial adapter looks like to a host."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import threading
import time
import tty
from collections.abc import Callable
from pathlib import Path

from stage_core.errors import StageError
from stage_twin.emulators.zaber import ZaberChain

#: Without traffic the chain is polled this often for alerts and late replies [s].
POLL_PERIOD = 0.005


class ZaberPty:
    """Serves a chain on a pseudo-terminal in a thread of its own.

    Parameters
    ----------
    chain
        The emulated devices.
    link
        Symbolic link that keeps pointing to the terminal, also after the cable was pulled.
    exchange_time
        None: the plant follows the wall clock. Else every line from the host lets this much time
        pass [s], whatever the pieces in which it comes: nothing depends on the machine's speed.
    advanced
        Called with the plant's time [s] after each step, in the server's thread.
    """

    def __init__(
        self,
        chain: ZaberChain,
        link: str | Path | None = None,
        exchange_time: float | None = None,
        advanced: Callable[[float], None] | None = None,
    ) -> None:
        self.chain = chain
        self.port = ''
        self._link = Path(link) if link else None
        self._exchange_time = exchange_time
        self._advanced = advanced
        self._start = time.monotonic()
        self._time = 0.0
        self._exchanges = 0
        self._lock = threading.Lock()
        self._master = self._slave = -1
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name='zaber_pty', daemon=True)

    def __enter__(self) -> ZaberPty:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self) -> None:
        """Open the terminal and serve it."""
        self.plug()
        self._thread.start()

    def close(self) -> None:
        """End the thread and remove the terminal."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)
        self.unplug()

    def plug(self) -> None:
        """Put the cable in: a new terminal appears (and the link points to it).

        Raises
        ------
        StageError
            If the link cannot be made, or something else has its name.
        """
        with self._lock:
            if self._master >= 0:
                return
            self._master, self._slave = pty.openpty()
            for descriptor in (self._master, self._slave):
                tty.setraw(descriptor)
            os.set_blocking(self._master, False)
            self.port = os.ttyname(self._slave)
            if self._link is None:
                return
            try:
                if self._link.is_symlink():
                    self._link.unlink()
                self._link.symlink_to(self.port)
            except OSError as error:
                raise StageError(
                    f'cannot make the link {self._link} to the emulated port: {error.strerror}'
                ) from error

    def unplug(self) -> None:
        """Pull the cable: the host's terminal hangs up. The devices keep power and go on."""
        with self._lock:
            for descriptor in (self._master, self._slave):
                if descriptor >= 0:
                    os.close(descriptor)
            self._master = self._slave = -1
            if self._link is not None and self._link.is_symlink():
                self._link.unlink()

    def power_cycle(self) -> None:
        """Switch the chain off and on."""
        with self._lock:
            self.chain.power_cycle()

    def _run(self) -> None:
        while not self._ended.is_set():
            with self._lock:
                master = self._master
            if master < 0:
                time.sleep(POLL_PERIOD)
                readable = False
            else:
                try:
                    readable = bool(select.select([master], [], [], POLL_PERIOD)[0])
                except (OSError, ValueError):
                    # Unplugged while it was waited for.
                    continue
            with self._lock:
                self._serve(readable)

    def _serve(self, readable: bool) -> None:
        data = b''
        if readable and self._master >= 0:
            with contextlib.suppress(OSError):
                data = os.read(self._master, 4096)
        answer = b''
        lines: list[bytes | None] = [*self.chain.lines(data)]
        for line in lines or [None]:
            if self._exchange_time is None:
                self._time = time.monotonic() - self._start
            elif line is not None:
                self._exchanges += 1
                self._time = self._exchanges * self._exchange_time
            answer += self.chain.poll(self._time, line)
            if self._advanced is not None:
                self._advanced(self._time)
        if answer and self._master >= 0:
            # A host that does not read loses bytes, as with a real adapter's full buffer.
            with contextlib.suppress(OSError):
                os.write(self._master, answer)
