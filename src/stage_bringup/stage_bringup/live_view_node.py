"""``ros2 run stage_bringup live_view``: the running graph in a browser, without a ROS desktop.

Serves the topics of the stage over the Foxglove WebSocket protocol, with message definitions.
Messages are passed on as they come off the wire (CDR): nothing is decoded.
"""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Callable
from typing import Any

from session_bags.definitions import definition
from session_bags.graph_types import message_class
from stage_core import topics
from stage_core.errors import StageError
from stage_core.parameters import Parameter
from stage_node.node import LATCHED_QOS, OK, STATE_QOS, StageNode, run

PARAMETERS = (
    Parameter('host', '127.0.0.1', 'address to serve on', read_only=True),
    Parameter('port', 8765, 'TCP port to serve on', minimum=1, maximum=65535, read_only=True),
    Parameter(
        'max_rate',
        100.0,
        'most messages per second of one topic that are passed on',
        unit='Hz',
        minimum=0.1,
        maximum=10000.0,
    ),
)

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


def load_sdk() -> Any:
    """The module ``foxglove`` of foxglove-sdk.

    Raises
    ------
    StageError
        If it is not installed; nothing else of the workspace needs it.
    """
    try:
        return importlib.import_module('foxglove')
    except ImportError as error:
        raise StageError(
            'the live view needs foxglove-sdk, which is not installed: pip install foxglove-sdk'
        ) from error


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


class LiveView(StageNode):
    """Passes the graph's messages on to browsers."""

    def __init__(self) -> None:
        super().__init__('live_view', PARAMETERS)
        sdk = load_sdk()
        try:
            self._server = sdk.start_server(
                name='stage', host=self.value('host'), port=self.value('port')
            )
        except (OSError, RuntimeError) as error:
            raise StageError(
                f'cannot serve on {self.value("host")}:{self.value("port")} ({error}): choose '
                'another parameter port'
            ) from error
        self._latched: dict[str, bytes] = {}
        self._channels: dict[str, Any] = {}
        self._passed = 0
        for topic in SHOWN:
            self._channels[topic] = channel(sdk, topic)
            qos = LATCHED_QOS if topic in topics.LATCHED else STATE_QOS
            callback = self._callback(topic)
            kind = message_class(topics.TOPIC_TYPES[topic])
            self.create_subscription(kind, topic, callback, qos, raw=True)
        # A browser that connects later has missed what is published once only.
        self.create_timer(1.0, self._repeat)
        self.diagnostics.task('view', self._status)
        self.get_logger().info(f'serving ws://{self.value("host")}:{self.value("port")}')

    def _callback(self, topic: str) -> Callable[[bytes], None]:
        thinner = Thinner()

        def arrived(data: bytes) -> None:
            if topic in topics.LATCHED:
                self._latched[topic] = data
            elif topic != topics.DIAGNOSTICS and not thinner.passes(self.value('max_rate')):
                return
            self._channels[topic].log(data)
            self._passed += 1

        return arrived

    def _repeat(self) -> None:
        for topic, data in self._latched.items():
            self._channels[topic].log(data)

    def _status(self) -> tuple[bytes, str, dict[str, Any]]:
        return OK, 'serving', {'messages': self._passed}

    def shutdown(self) -> None:
        """Close the server."""
        self._server.stop()


def main() -> None:
    """Run the node."""
    sys.exit(run(LiveView))


if __name__ == '__main__':
    main()
