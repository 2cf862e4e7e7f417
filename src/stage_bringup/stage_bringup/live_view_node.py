"""``ros2 run stage_bringup live_view``: the running graph in a browser, without a ROS desktop.

Serves a page of its own over http. Where foxglove-sdk is installed, it serves the topics of the
stage over the Foxglove WebSocket protocol too, as they come off the wire (CDR).
"""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Callable
from typing import Any

from session_bags.definitions import definition
from session_bags.graph_types import message_class
from stage_bringup.live_page import LivePage
from stage_bringup.live_state_node import LiveState
from stage_core import topics
from stage_core.errors import StageError
from stage_core.parameters import Parameter
from stage_core.ros.node import LATCHED_QOS, OK, STATE_QOS, StageNode, run

PARAMETERS = (
    Parameter('host', '127.0.0.1', 'address to serve on', read_only=True),
    Parameter('page_port', 8766, 'TCP port of the page', minimum=1, maximum=65535, read_only=True),
    Parameter(
        'port', 8765, 'TCP port of the Foxglove socket', minimum=1, maximum=65535, read_only=True
    ),
    Parameter(
        'max_rate',
        100.0,
        'most messages per second of one topic that are passed on',
        unit='Hz',
        minimum=0.1,
        maximum=10000.0,
    ),
)

#: Messages per second of one topic that the page is made from.
PAGE_RATE = 20.0

SHOWN = (
    topics.TARGET,
    topics.SETPOINT,
    topics.REFERENCE,
    topics.COMMAND,
    topics.JOINT_STATES,
    topics.TEMPERATURE,
    topics.CONTACT_FORCE,
    topics.TRACKER_POINT,
    topics.ALIGNMENT,
    topics.CONTOUR_ERROR,
    topics.MODEL,
    topics.DIAGNOSTICS,
)


def load_sdk() -> Any | None:
    """The module ``foxglove`` of foxglove-sdk, or None: nothing else of the workspace needs it."""
    try:
        return importlib.import_module('foxglove')
    except ImportError:
        return None


def channel(sdk: Any, topic: str) -> Any:
    """Channel of a topic, with the definition of its ROS 2 message type as schema."""
    name = topics.TOPIC_TYPES[topic]
    text, _ = definition(name)
    schema = sdk.Schema(name=name, encoding='ros2msg', data=text.encode())
    return sdk.Channel(topic, message_encoding='cdr', schema=schema)


class Thinner:
    """Lets at most `rate` messages a second [Hz] of one topic through."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._next = -float('inf')

    def passes(self, rate: float) -> bool:
        """Whether a message that comes now is passed on."""
        now = self._clock()
        if now < self._next:
            return False
        # On a grid of the period, so that jitter does not lower the rate; never in arrears.
        self._next = max(self._next + 1.0 / rate, now)
        return True


class Foxglove:
    """Serves raw messages over the Foxglove WebSocket protocol.

    Raises
    ------
    StageError
        If the port is taken.
    """

    def __init__(self, sdk: Any, host: str, port: int) -> None:
        # Before the server, which can refuse a browser that subscribes at once to a new channel.
        self._channels = {topic: channel(sdk, topic) for topic in SHOWN}
        self._latched: dict[str, bytes] = {}
        try:
            self._server = sdk.start_server(name='stage', host=host, port=port)
        except (OSError, RuntimeError) as error:
            raise StageError(
                f'cannot serve on {host}:{port} ({error}): choose another parameter port'
            ) from error

    def take(self, topic: str, data: bytes) -> None:
        """Pass one message on."""
        if topic in topics.LATCHED:
            self._latched[topic] = data
        self._channels[topic].log(data)

    def repeat(self) -> None:
        """Send again what is published once only: a browser that connects later has missed it."""
        for topic, data in self._latched.items():
            self._channels[topic].log(data)

    def close(self) -> None:
        """End the server."""
        self._server.stop()


class LiveView(StageNode):
    """Shows the graph's messages to browsers: on its own page, and over the Foxglove protocol."""

    def __init__(self) -> None:
        super().__init__('live_view', PARAMETERS)
        host = self.value('host')
        sdk = load_sdk()
        self._foxglove = None if sdk is None else Foxglove(sdk, host, self.value('port'))
        self._state = LiveState(self)
        self._page = LivePage(host, self.value('page_port'), self._state.now, self._state.stop)
        self._passed = 0
        for topic in SHOWN:
            qos = LATCHED_QOS if topic in topics.LATCHED else STATE_QOS
            callback = self._callback(topic)
            kind = message_class(topics.TOPIC_TYPES[topic])
            self.create_subscription(kind, topic, callback, qos, raw=True)
        if self._foxglove is not None:
            self.create_timer(1.0, self._foxglove.repeat)
        self.diagnostics.task('view', self._status)
        self.get_logger().info(f'open http://{host}:{self._page.port} in a browser')
        if self._foxglove is None:
            self.get_logger().info('no Foxglove socket: pip install foxglove-sdk adds it')
        else:
            self.get_logger().info(f'Foxglove socket: ws://{host}:{self.value("port")}')

    def _callback(self, topic: str) -> Callable[[bytes], None]:
        to_socket, to_page = Thinner(), Thinner()
        always = topic in topics.LATCHED or topic == topics.DIAGNOSTICS

        def arrived(data: bytes) -> None:
            if topic == topics.REFERENCE:
                self._state.keep_reference(data)
            elif always or to_page.passes(PAGE_RATE):
                self._state.take(topic, data)
            if self._foxglove is not None and (always or to_socket.passes(self.value('max_rate'))):
                self._foxglove.take(topic, data)
                self._passed += 1

        return arrived

    def _status(self) -> tuple[bytes, str, dict[str, Any]]:
        return OK, 'serving', {'messages': self._passed}

    def shutdown(self) -> None:
        """End both servers."""
        self._page.close()
        if self._foxglove is not None:
            self._foxglove.close()


def main() -> None:
    """Run the node."""
    sys.exit(run(LiveView))


if __name__ == '__main__':
    main()
