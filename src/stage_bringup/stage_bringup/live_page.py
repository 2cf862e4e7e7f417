"""The page of the live view over http: position, errors, states, alarms, and a stop button.

`GET /` is the page, `GET /events` its stream of states (server-sent events), `POST /stop` stops
the stage. Only a page that this server gave may stop it: see `_foreign`.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from stage_core.errors import StageError
from stage_core.pages import css

#: Seconds between two states of the stream.
PERIOD = 0.1
#: The page loads nothing from elsewhere.
POLICY = "default-src 'self'; img-src data:; script-src 'unsafe-inline'; style-src 'unsafe-inline'"


def page_text() -> str:
    """The page, in the style of the reports."""
    template = (Path(__file__).parent / 'live_page.html').read_text(encoding='utf-8')
    return template.replace('/*css*/', css())


class LivePage:
    """Serves the page on a thread of its own.

    Parameters
    ----------
    state : what a browser is sent now; JSON-able.
    stop : stops the stage and says what came of it.

    Raises
    ------
    StageError
        If the port is taken.
    """

    def __init__(
        self,
        host: str,
        port: int,
        state: Callable[[], dict[str, Any]],
        stop: Callable[[], str],
    ) -> None:
        self.state, self.stop_stage = state, stop
        self.ended = threading.Event()
        handler = type('Handler', (_Handler,), {'page': self})
        try:
            self._server = ThreadingHTTPServer((host, port), handler)
        except OSError as error:
            raise StageError(
                f'cannot serve the page on {host}:{port} ({error.strerror}): choose another '
                'parameter page_port'
            ) from error
        self._server.daemon_threads = True
        self.port = int(self._server.server_address[1])
        threading.Thread(target=self._server.serve_forever, name='page', daemon=True).start()

    def close(self) -> None:
        """End the server and its streams."""
        self.ended.set()
        self._server.shutdown()
        self._server.server_close()


class _Handler(BaseHTTPRequestHandler):
    page: LivePage
    timeout = 30.0

    def do_GET(self) -> None:
        if self.path == '/':
            self._answer(200, 'text/html; charset=utf-8', page_text())
        elif self.path == '/events':
            self._stream()
        else:
            self._answer(404, 'text/plain', 'not here: the page is /')

    def do_POST(self) -> None:
        if self.path != '/stop':
            self._answer(404, 'text/plain', 'not here: stop the stage with POST /stop')
        elif self._foreign():
            self._answer(403, 'text/plain', 'only the page of this server may stop the stage')
        else:
            self._answer(200, 'text/plain; charset=utf-8', self.page.stop_stage())

    def _foreign(self) -> bool:
        """Whether a page of another server asks; programs that are no browser name no origin."""
        origin = self.headers.get('Origin')
        return origin is not None and urlsplit(origin).netloc != self.headers.get('Host')

    def _answer(self, status: int, kind: str, text: str) -> None:
        body = text.encode()
        self.send_response(status)
        self.send_header('Content-Type', kind)
        self.send_header('Content-Length', str(len(body)))
        self.send_header('Content-Security-Policy', POLICY)
        self.end_headers()
        self.wfile.write(body)

    def _stream(self) -> None:
        self.send_response(200)
        self.send_header('Content-Type', 'text/event-stream')
        self.send_header('Cache-Control', 'no-store')
        self.end_headers()
        try:
            while not self.page.ended.wait(PERIOD):
                self.wfile.write(f'data: {json.dumps(self.page.state())}\n\n'.encode())
        except OSError:
            # The browser has gone.
            pass

    def log_message(self, format: str, *args: object) -> None:
        """No line for each request: the node's log is for the stage."""
