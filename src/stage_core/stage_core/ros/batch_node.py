"""Topics that are taken in batches: for who watches a stream and need not answer each message.

The executor of rclpy spends more on waking up for a message than on the message. A subscription
that it does not know costs what the middleware needs to keep the message until it is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.type_support import check_is_valid_msg_type

#: Between two batches [s of wall time].
PERIOD = 0.05
#: Kept by the middleware until they are taken: a lockstep of 10 kHz for half a second.
BATCH_QOS = QoSProfile(depth=5000, reliability=ReliabilityPolicy.RELIABLE)

#: Takes a message as CDR bytes, and what the middleware tells of it.
Taker = Callable[[bytes, dict[str, int]], None]


class Batches:
    """Subscriptions of a node whose messages are taken together, every `period` [s of wall time].

    Each topic's messages are taken in their order; topics one after the other. `after` is called
    when all of a batch are taken.
    """

    def __init__(
        self, node: Any, after: Callable[[], None] = lambda: None, period: float = PERIOD
    ) -> None:
        self._node, self._after = node, after
        self._topics: list[tuple[Any, type, Taker]] = []
        node.create_timer(period, self.take, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def create_subscription(
        self, message_type: type, topic: str, taker: Taker, qos: QoSProfile = BATCH_QOS
    ) -> None:
        """Subscribe to a topic."""
        check_is_valid_msg_type(message_type)
        with self._node.handle:
            handle = rclpy_implementation.Subscription(
                self._node.handle, message_type, topic, qos.get_c_qos_profile()
            )
        self._topics.append((handle, message_type, taker))

    def take(self) -> None:
        """Take what has come; also to be called before what was heard is used."""
        for handle, message_type, taker in self._topics:
            with handle:
                while (taken := handle.take_message(message_type, True)) is not None:
                    taker(*taken)
        self._after()
