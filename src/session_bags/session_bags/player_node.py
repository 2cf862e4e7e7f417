"""Node that replays a session."""

from __future__ import annotations

import heapq
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from rosgraph_msgs.msg import Clock

from session_bags.bag import open_bag
from session_bags.cdr import stamp_in
from session_bags.graph_types import has_header, message_class
from session_bags.messages import RawMessage, raw_messages
from stage_core import topics
from stage_core.clocks import split_stamp
from stage_core.errors import StageError
from stage_core.parameters import Parameter
from stage_core.ros.node import ERROR, LATCHED_QOS, OK, STATE_QOS, StageNode, run

#: Messages that wait while earlier stamps may still arrive.
_REORDER = 2000
#: /clock goes on at least this often [s of wall time].
_CLOCK_PERIOD = 0.01
#: A live driver would follow these; they are replayed on request only.
_MOVING = frozenset({topics.SETPOINT, topics.TARGET})

PARAMETERS = (
    Parameter('bag', '', 'Session bag to replay', read_only=True),
    Parameter('rate', 1.0, 'Replayed seconds per second', '', 1e-3, 1e3, read_only=True),
    Parameter('start', 0.0, 'Where to begin, since the first stamp', 's', 0.0, read_only=True),
    Parameter('loop', False, 'Begin again at the end', read_only=True),
    Parameter(
        'topics', [''], 'Topics to replay; where empty, all that move no stage', read_only=True
    ),
    Parameter('delay', 1.0, 'Wait before the first message', 's', 0.0, 60.0, read_only=True),
    Parameter(
        'wait_for_subscribers', False, 'Begin once every topic has a subscriber', read_only=True
    ),
    Parameter('clock', True, 'Publish /clock', read_only=True),
)


class SessionPlayer(StageNode):
    """Publishes the messages of a bag, unchanged, at the pace of their stamps."""

    def __init__(self) -> None:
        super().__init__('session_player', PARAMETERS)
        if not self.value('bag'):
            raise StageError('session_player: the parameter bag is empty: name a session bag')
        self._bag = open_bag(self.value('bag'))
        types = self._bag.topic_types()
        named = {topic for topic in self.value('topics') if topic}
        missing = sorted(named - types.keys())
        if missing:
            raise StageError(f'{self.value("bag")} has no topic {missing[0]}: it has '
                             f'{", ".join(sorted(types))}')  # fmt: skip
        chosen = named or types.keys() - _MOVING - {topics.CLOCK}
        self._headers = {topic: has_header(types[topic]) for topic in chosen}
        self._publishers_of = {
            topic: self.create_publisher(
                message_class(types[topic]),
                topic,
                LATCHED_QOS if topic in topics.LATCHED else STATE_QOS,
            )
            for topic in chosen
        }
        self._clock_publisher = (
            self.create_publisher(Clock, topics.CLOCK, 10) if self.value('clock') else None
        )
        self._played = 0
        self._last_tick = -1
        self._failure = ''
        self._ended = threading.Event()
        self.diagnostics.task('replay', self._status)
        self._thread = threading.Thread(target=self._play, name='replay', daemon=True)
        self._thread.start()

    def _status(self) -> tuple[bytes, str, dict[str, Any]]:
        if self._failure:
            return ERROR, self._failure, {}
        return OK, 'replaying', {'bag': self.value('bag'), 'messages': self._played}

    def _stamped(self) -> Iterator[tuple[int, int, RawMessage]]:
        """Messages with their stamps, in order of stamps."""
        waiting: list[tuple[int, int, RawMessage]] = []
        lag = 0
        for number, message in enumerate(raw_messages(self._bag, self._headers.keys())):
            if self._headers[message.topic]:
                stamp = stamp_in(message.data)
                lag = message.log_time - stamp
            else:
                stamp = message.log_time - lag
            heapq.heappush(waiting, (stamp, number, message))
            if len(waiting) > _REORDER:
                yield heapq.heappop(waiting)
        while waiting:
            yield heapq.heappop(waiting)

    def _play(self) -> None:
        self._ended.wait(self.value('delay'))
        if self.value('wait_for_subscribers'):
            publishers = self._publishers_of.values()
            while not all(p.get_subscription_count() for p in publishers):
                if self._ended.wait(0.05):
                    return
        try:
            while not self._ended.is_set():
                played = self._played
                self._play_once()
                if self._played == played and not self._ended.is_set():
                    raise StageError(
                        f'{self.value("bag")} holds no message to replay from '
                        f'{self.value("start"):g} s on: set an earlier start or other topics'
                    )
                if not self.value('loop'):
                    break
        except StageError as error:
            self._failure = str(error)
            self.get_logger().error(self._failure)
        if not self._ended.is_set():
            # Reliable messages leave before the participant does.
            time.sleep(0.5)
            rclpy.try_shutdown()

    def _play_once(self) -> None:
        rate, skip = self.value('rate'), round(self.value('start') * 1e9)
        first: int | None = None
        begin = 0.0
        kept: dict[str, RawMessage] = {}
        for stamp, _, message in self._stamped():
            if first is None:
                first, begin = stamp, time.monotonic()
            if stamp - first < skip:
                if message.topic in topics.LATCHED:
                    kept[message.topic] = message
                continue
            for latched in kept.values():
                self._publish(latched)
            kept = {}
            due = begin + (stamp - first - skip) * 1e-9 / rate
            while (wait := due - time.monotonic()) > 0.0:
                if self._ended.wait(min(wait, _CLOCK_PERIOD)):
                    return
                self._tick(
                    min(stamp, first + skip + round((time.monotonic() - begin) * rate * 1e9))
                )
            if self._ended.is_set():
                return
            self._tick(stamp)
            self._publish(message)

    def _tick(self, stamp: int) -> None:
        if self._clock_publisher is not None and stamp != self._last_tick:
            self._last_tick = stamp
            seconds, nanoseconds = split_stamp(stamp)
            self._clock_publisher.publish(Clock(clock=Time(sec=seconds, nanosec=nanoseconds)))

    def _publish(self, message: RawMessage) -> None:
        self._publishers_of[message.topic].publish(message.data)
        self._played += 1

    def now(self) -> int:
        """The time of the replay [ns]: recorded once more, all is on one time line."""
        playing = self._clock_publisher is not None and self._last_tick >= 0
        return self._last_tick if playing else super().now()

    def shutdown(self) -> None:
        """End the replay."""
        self._ended.set()
        self._thread.join(timeout=2.0)


def main() -> None:
    """Run the node."""
    sys.exit(run(SessionPlayer))
