"""Requests and answers over a serial line: ids, timeouts, retries, a reader thread.

The reader dispatches by first byte and message id, never by "the next line": replies may be lost,
late, doubled or from another device, and alerts come between any two lines.
"""

from __future__ import annotations

import contextlib
import errno
import os
import termios
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import dataclass
from urllib.parse import urlsplit

import serial

from stage_core.errors import StageError
from stage_core.ownership import Ownership, address
from stage_driver.protocol import (
    LARGEST_ID,
    Alert,
    Assembler,
    LineSplitter,
    ProtocolError,
    Reply,
    decode_answer,
    encode_command,
)

#: The id of an unanswered request is not used again for this time: its reply may be late [s].
QUARANTINE = 5.0

#: A port that takes nothing for so long is gone [s]. pyserial counts the time in which this thread
#: got no processor, also behind a line that was written: 0.5 s took load for a pulled cable.
WRITE_TIMEOUT = 5.0

#: Errors of a port that may still come: no such file or device, or nobody listens there yet.
_ABSENT = (errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.ECONNREFUSED)


class PortAbsent(StageError):
    """There is no such port yet."""


class LinkLost(Exception):
    """The port is gone: cable pulled, adapter removed, connection closed."""


class NoAnswer(Exception):
    """A request was not answered in time."""


class AnswersLate(NoAnswer):
    """The devices are there, but this computer is too busy to hear them in time."""


def advice(error: Exception) -> str:
    """What a user does about an answer that did not come."""
    return str(error) if isinstance(error, AnswersLate) else f'{error}: check power and cable'


@contextlib.contextmanager
def advised() -> Iterator[None]:
    """A missing answer is a StageError with what a user does about it."""
    try:
        yield
    except NoAnswer as error:
        raise StageError(advice(error)) from error


@dataclass(frozen=True)
class Query:
    """A command for one device and axis; `words` as in the manual."""

    words: str
    device: int
    axis: int = 0


class ZaberLink:
    """One open port.

    Parameters
    ----------
    url
        Anything `serial.serial_for_url` takes: a device, a pseudo-terminal, `socket://host:port`.
    baud
        Baud rate of a serial device.
    timeout
        Longest wait for a reply [s].
    line_sent
        Called after each command line.

    Raises
    ------
    StageError
        If the port cannot be opened or another driver has it; `PortAbsent` where it may come.
    """

    def __init__(
        self,
        url: str,
        baud: int = 115200,
        timeout: float = 0.2,
        line_sent: Callable[[], None] = lambda: None,
    ) -> None:
        self.url = url
        self.timeout = timeout
        self._line_sent = line_sent
        self.counts: Counter[str] = Counter()
        #: How many stops were asked for; a motion that is older than the last one is over.
        self.stops = 0
        self.garbage_sample = b''
        self._owned = Ownership(_wire(url), 'stage_driver', 'give this driver another port')
        try:
            self._port = serial.serial_for_url(
                url, baudrate=baud, timeout=0.05, write_timeout=WRITE_TIMEOUT
            )
        except (serial.SerialException, OSError, ValueError, termios.error) as error:
            self._owned.close()
            kind = PortAbsent if _number(error) in _ABSENT else StageError
            raise kind(
                f'cannot open port {url}: {_reason(error)}: check parameter port, the cable and '
                'the rights on the device'
            ) from error
        with contextlib.suppress(Exception):
            # FTDI adapters wait 16 ms by default; other ports have no such mode.
            self._port.set_low_latency_mode(True)
        self._pending: dict[int, tuple[Query, Future[Reply]]] = {}
        self._quarantined: dict[int, float] = {}
        self._next_id = 0
        self._lock = threading.Lock()
        self._write_lock = threading.Lock()
        self._lost = threading.Event()
        self._reader = threading.Thread(target=self._read, name='zaber_reader', daemon=True)
        self._reader.start()

    @property
    def lost(self) -> bool:
        """Whether the port is gone."""
        return self._lost.is_set()

    def close(self) -> None:
        """Close the port and end the reader."""
        self._lost.set()
        self._reader.join(timeout=2.0)
        # A stop from another thread finds the port open, or closed.
        with self._write_lock, contextlib.suppress(Exception):
            self._port.close()
        self._owned.close()

    def ask(self, words: str, device: int, axis: int = 0, retries: int = 2) -> Reply:
        """Ask for something that may be asked again; never for a motion.

        Raises
        ------
        NoAnswer, LinkLost
        """
        late = self.counts['late']
        for attempt in range(retries + 1):
            reply = self.ask_all([Query(words, device, axis)])[0]
            if reply is not None:
                return reply
            self.counts['retries'] += attempt < retries
        self.refuse_late(late)
        raise NoAnswer(f'device {device} at {self.url} does not answer to {words or "status"!r}')

    def refuse_late(self, before: int) -> None:
        """AnswersLate where late answers came since their count was `before`."""
        if self.counts['late'] > before:
            raise AnswersLate(
                f'{self.url} answers later than {self.timeout} s: lower the load of this computer'
            )

    def ask_all(self, queries: Sequence[Query]) -> list[Reply | None]:
        """Send all at once, then collect; None where no answer came in time.

        Raises
        ------
        LinkLost
        """
        waiting = [self._send(query) for query in queries]
        deadline = time.monotonic() + self.timeout
        replies: list[Reply | None] = []
        for number, future in waiting:
            try:
                replies.append(future.result(max(0.0, deadline - time.monotonic())))
            except FutureTimeout:
                replies.append(None)
                self.counts['timeouts'] += 1
                with self._lock:
                    self._pending.pop(number, None)
                    self._quarantined[number] = time.monotonic()
        if self.lost:
            raise LinkLost(f'port {self.url} is gone')
        return replies

    def stop(self) -> bool:
        """Broadcast `stop` without waiting, behind nothing else; whether it could be written."""
        with self._lock:
            self.stops += 1
        try:
            self._write(encode_command('stop'))
        except LinkLost:
            return False
        return True

    def _send(self, query: Query) -> tuple[int, Future[Reply]]:
        future: Future[Reply] = Future()
        with self._lock:
            number = self._free_id()
            self._pending[number] = (query, future)
        self._write(encode_command(query.words, query.device, query.axis, number))
        return number, future

    def _free_id(self) -> int:
        """Next id that no open or recently unanswered request has."""
        now = time.monotonic()
        for number, since in list(self._quarantined.items()):
            if now - since > QUARANTINE:
                del self._quarantined[number]
        for _ in range(LARGEST_ID + 1):
            number = self._next_id
            self._next_id = (number + 1) % (LARGEST_ID + 1)
            if number not in self._pending and number not in self._quarantined:
                return number
        oldest = min(self._quarantined, key=self._quarantined.__getitem__)
        del self._quarantined[oldest]
        return oldest

    def _write(self, data: bytes) -> None:
        try:
            with self._write_lock:
                self._port.write(data)
                self._line_sent()
        except (serial.SerialException, OSError, termios.error) as error:
            self._lost.set()
            raise LinkLost(f'port {self.url} is gone: {_reason(error)}') from error

    def _read(self) -> None:
        splitter, assembler = LineSplitter(), Assembler()
        while not self._lost.is_set():
            try:
                data = self._port.read(self._port.in_waiting or 1)
            except (serial.SerialException, OSError, TypeError, termios.error):
                # TypeError: pyserial's descriptor is None after a close from another thread.
                self._lost.set()
                return
            for line in splitter.feed(data):
                try:
                    answer = assembler.add(decode_answer(line))
                except ProtocolError:
                    self.counts['garbage'] += 1
                    self.garbage_sample = line[:40]
                    continue
                if isinstance(answer, Reply):
                    self._resolve(answer)
                elif isinstance(answer, Alert):
                    # Polls see the end of a move anyway.
                    self.counts['alerts'] += 1

    def _resolve(self, reply: Reply) -> None:
        """Hand a reply to the request of its id, device and axis; others are late or strays."""
        with self._lock:
            found = self._pending.get(-1 if reply.message_id is None else reply.message_id)
            if found is None or found[0].device != reply.device or found[0].axis != reply.axis:
                # Replies without an id are those to the broadcasts of `stop`.
                late = reply.message_id in self._quarantined
                self.counts['late' if late else 'strays'] += reply.message_id is not None
                return
            del self._pending[reply.message_id if reply.message_id is not None else -1]
        found[1].set_result(reply)


def _number(error: BaseException | None) -> int | None:
    """Number of the system's error; pyserial's sockets keep it in the context."""
    if error is None:
        return None
    found = getattr(error, 'errno', None)
    return found if isinstance(found, int) else _number(error.__context__)


def _reason(error: BaseException) -> str:
    """The system's own words, without pyserial's nesting."""
    if isinstance(error, OSError) and error.errno:
        return os.strerror(error.errno)
    return ' '.join(str(error).split())


def _wire(url: str) -> str:
    """The port in the same words, by whatever link or host name it is reached."""
    with contextlib.suppress(ValueError):
        # Who opens the port refuses a number that is none.
        host = urlsplit(url)
        if host.hostname and host.port:
            return f'port {host.scheme}://{address(host.hostname, host.port)}'
    return f'port {url if "://" in url else os.path.realpath(url)}'
