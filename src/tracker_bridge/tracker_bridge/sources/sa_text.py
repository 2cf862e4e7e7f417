"""SpatialAnalyzer text datagrams over UDP."""

from __future__ import annotations

import socket
import time

from stage_core.errors import StageError
from tracker_bridge.sa_text import SaFormat, SaTextDecoder, SaTextError
from tracker_bridge.sources.base import POLL, Deliver, Source


class SaTextSource(Source):
    """Listen for datagrams; those that hold no point are counted and the reason kept.

    Parameters
    ----------
    host, port
        Local address to listen on; port 0 takes a free one (see attribute `port`).
    form
        How SpatialAnalyzer is set up.

    Raises
    ------
    StageError
        When the port is taken.
    """

    def __init__(self, deliver: Deliver, host: str, port: int, form: SaFormat) -> None:
        super().__init__(deliver)
        self.decoder = SaTextDecoder(form)
        self._form = form
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise StageError(
                f'cannot listen on {host}:{port} ({error.strerror}): set host to an address of '
                'this machine and port to a free one'
            ) from error
        self._socket.settimeout(POLL)
        self.port: int = self._socket.getsockname()[1]
        self._silence = (
            f'no datagrams on UDP port {self.port}: start the broadcast of the watch window in '
            'SpatialAnalyzer, to this machine and port'
        )
        self.trouble = self._silence

    def new_session(self) -> None:
        """Take the unit of the next datagram as the session's."""
        self.decoder = SaTextDecoder(self._form)

    def run(self) -> None:
        """Listen until `stop`."""
        heard = time.monotonic()
        while not self.ended.is_set():
            try:
                datagram = self._socket.recv(65536)
            except TimeoutError:
                if time.monotonic() - heard > 2.0:
                    self.connected, self.trouble = False, self._silence
                continue
            heard = time.monotonic()
            self.connected = True
            try:
                sample = self.decoder.decode(datagram, time.time_ns())
            except SaTextError as error:
                self.count('refused_datagrams')
                self.trouble = str(error)
                continue
            self.trouble = ''
            self.deliver(sample)
        self._socket.close()
