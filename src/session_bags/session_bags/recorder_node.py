"""Node that records a session."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

import rclpy.clock
from rclpy.qos import QoSProfile, ReliabilityPolicy

from session_bags.cdr import stamp_in
from session_bags.definitions import definition
from session_bags.drops import DropCounter
from session_bags.graph_types import has_header, message_class
from session_bags.writer import SessionWriter
from stage_core import topics
from stage_core.errors import StageError
from stage_core.parameters import Parameter, Value
from stage_core.ros.batch_node import Batches
from stage_core.ros.node import ERROR, LATCHED_QOS, OK, WARN, StageNode, run
from stage_core.ros.services_node import create_trigger_service
from stage_core.twin_file import TwinFile

_NAME = re.compile(r'[A-Za-z0-9][A-Za-z0-9_.-]*')
DROPPED_KEY = 'dropped'
_ALL = '*'

#: Deeper than what publishers keep: a recorder that gets no processor for seconds loses nothing.
RECORDER_QOS = QoSProfile(depth=10_000, reliability=ReliabilityPolicy.RELIABLE)

PARAMETERS = (
    Parameter('directory', 'bags', 'Folder that new bags are written to', read_only=True),
    Parameter('name', 'session', 'Name of the next bag; a number is added where it exists'),
    Parameter(
        'topics', list(topics.SESSION_TOPICS), 'Topics to record; * for all', read_only=True
    ),
    Parameter('autostart', False, 'Record from the beginning', read_only=True),
    Parameter('twin', '', 'Nominal twin file to keep in the bag; none where empty'),
    Parameter(
        'chunk_period', 0.5, 'A kill loses at most this much', 's', 0.05, 1.0, read_only=True
    ),
)


class SessionRecorder(StageNode):
    """Subscribes to the session's topics and writes them between ``~/start`` and ``~/stop``."""

    def __init__(self) -> None:
        super().__init__('session_recorder', PARAMETERS)
        wrong = self.parameters_changed({'name': self.value('name')})
        if wrong:
            raise StageError(f'parameter of session_recorder: {wrong}')
        self._writer: SessionWriter | None = None
        self._failure = ''
        self._drops: dict[str, DropCounter] = {}
        self._latched: dict[str, bytes] = {}
        self._opening: dict[str, bytes] = {}
        self._pending = set(self.value('topics'))
        self._topics: set[str] = set()
        self._left_out: dict[str, str] = {}
        self._taken: list[tuple[str, str, bytes, bool, dict[str, int]]] = []
        self._batches = Batches(self, self._write_batch)
        self._subscribe()
        create_trigger_service(self, '~/start', self._start)
        create_trigger_service(self, '~/stop', self._stop)
        self.diagnostics.task('recording', self._status)
        # A steady clock: chunks close although simulated time stands still.
        steady = rclpy.clock.Clock(clock_type=rclpy.clock.ClockType.STEADY_TIME)
        self.create_timer(0.5 * self.value('chunk_period'), self._flush, clock=steady)
        self.create_timer(1.0, self._watch_graph, clock=steady)
        if self.value('autostart'):
            self._start()

    def parameters_changed(self, changed: dict[str, Value]) -> str | None:
        """Refuse a name that could leave the directory."""
        name = changed.get('name')
        if isinstance(name, str) and not _NAME.fullmatch(name):
            return (
                f'name must be letters, digits, dots, dashes and underscores, got {name!r}: '
                'bags are written to the parameter directory only'
            )
        return None

    def _subscribe(self) -> None:
        """Subscribe to what has a known type; other topics once somebody publishes them."""
        found: dict[str, list[str]] = {}
        if self._pending - topics.TOPIC_TYPES.keys():
            found = dict(self.get_topic_names_and_types())
        if _ALL in self._pending:
            self._pending |= found.keys() - self._topics - {topics.CLOCK}
        for topic in sorted(self._pending):
            type_name = topics.TOPIC_TYPES.get(topic) or next(iter(found.get(topic, ())), None)
            if type_name is None:
                continue
            self._pending.discard(topic)
            self._topics.add(topic)
            try:
                kind, _ = message_class(type_name), definition(type_name)
            except StageError as error:
                self._leave_out(topic, error)
                continue
            self._drops[topic] = DropCounter()
            self._batches.create_subscription(
                kind,
                topic,
                self._taker(topic, type_name),
                LATCHED_QOS if topic in topics.LATCHED else RECORDER_QOS,
            )

    def _leave_out(self, what: str, error: StageError) -> None:
        """Say once what a stranger's topic lacks: it must not end the recording of the rest."""
        if what not in self._left_out:
            self._left_out[what] = f'{what} is not recorded: {error}'
            self.get_logger().warning(self._left_out[what])

    def _taker(self, topic: str, type_name: str) -> Any:
        header = has_header(type_name)

        def take(data: bytes, info: dict[str, int]) -> None:
            if topic in topics.LATCHED:
                self._latched[topic] = data
            if self._writer is not None:
                self._taken.append((topic, type_name, data, header, info))

        return take

    def _write_batch(self) -> None:
        """Write what was taken in the order of its arrival."""
        taken, self._taken = self._taken, []
        taken.sort(key=lambda row: row[-1]['received_timestamp'])
        for topic, type_name, data, header, info in taken:
            if self._writer is not None:
                self._drops[topic].add(info['publication_sequence_number'])
                self._write(topic, type_name, data, header, info)

    def _write(
        self, topic: str, type_name: str, data: bytes, header: bool, info: dict[str, int]
    ) -> None:
        assert self._writer is not None
        try:
            # A bag has no time before the epoch.
            stamp = max(stamp_in(data), 0) if header else info['source_timestamp']
        except StageError as error:
            self._leave_out(f'a message of {topic}', error)
            return
        log_time = info['received_timestamp']
        published = stamp
        if self.value('use_sim_time'):
            # On one time line with the stamps, whatever the pace of the simulation.
            log_time = stamp if header else self.get_clock().now().nanoseconds
            published = info['source_timestamp']
        number = info['publication_sequence_number']
        try:
            self._write_opening(log_time, published)
            self._writer.add_topic(topic, type_name)
            self._writer.write(topic, data, log_time, published, number)
        except StageError as error:
            self._fail(error)

    def _write_opening(self, log_time: int, published: int | None = None) -> None:
        """Every bag stands alone: it begins with the alignment and model in force.

        They wait for the first message, whose time they take: simulated time may not have begun
        when the recording does.
        """
        assert self._writer is not None
        opening, self._opening = self._opening, {}
        for topic, data in opening.items():
            self._writer.write(topic, data, log_time, published)

    def _fail(self, error: StageError) -> None:
        self._failure = str(error)
        self._writer = None
        self.get_logger().error(self._failure)

    def _flush(self) -> None:
        if self._writer is not None:
            try:
                self._writer.flush_old()
            except StageError as error:
                self._fail(error)

    def _watch_graph(self) -> None:
        if self._pending:
            self._subscribe()
        for topic, counter in self._drops.items():
            if self.count_publishers(topic) > 1:
                counter.several_publishers = True

    def _start(self) -> str:
        """Open a new bag and begin it with the latched messages; its path."""
        if self._writer is not None:
            raise StageError(f'already recording to {self._writer.path}: stop first')
        # What came before belongs to no bag.
        self._batches.take()
        self._writer = self._open()
        self._failure = ''
        for topic in self._drops:
            self._drops[topic] = DropCounter()
        self._opening = dict(self._latched)
        self.get_logger().info(f'recording to {self._writer.path}')
        return str(self._writer.path)

    def _open(self) -> SessionWriter:
        twin = TwinFile.load(self.value('twin')) if self.value('twin') else None
        directory, name = Path(self.value('directory')), self.value('name')
        path, number = directory / name, 0
        while path.exists():
            number += 1
            path = directory / f'{name}_{number}'
        return SessionWriter(path, twin, chunk_period=self.value('chunk_period'))

    def _stop(self) -> str:
        if self._writer is None:
            raise StageError(self._failure or 'not recording: start first')
        try:
            return self._close()
        except StageError as error:
            self._fail(error)
            raise

    def _close(self) -> str:
        """Finish the bag; one line on what it holds."""
        self._batches.take()
        if self._writer is None:
            raise StageError(self._failure)
        self._write_opening(self.get_clock().now().nanoseconds)
        writer, self._writer = self._writer, None
        drops = {topic: c.known_drops for topic, c in self._drops.items() if c.received}
        writer.close({DROPPED_KEY: json.dumps(drops)})
        counted = sum(drop or 0 for drop in drops.values())
        return f'{writer.path}: {sum(writer.counts.values())} messages, {counted} dropped'

    def _status(self) -> tuple[bytes, str, dict[str, Any]]:
        if self._failure:
            return ERROR, self._failure, {}
        if self._writer is None:
            return OK, 'not recording', {}
        values: dict[str, Any] = {'bag': self._writer.path}
        for topic, counter in self._drops.items():
            if counter.received:
                known = 'unknown' if counter.known_drops is None else counter.known_drops
                values[topic] = f'{counter.received} received, {known} dropped'
        dropped = sum(c.known_drops or 0 for c in self._drops.values())
        if dropped:
            return WARN, f'{dropped} messages dropped: lower the load of this machine', values
        troubles = list(self._left_out.values())
        troubles += [
            f'{topic} is not recorded: nobody publishes it, see the parameter topics'
            for topic in sorted(self._pending - {_ALL})
        ]
        if troubles:
            return WARN, '; '.join(troubles), values
        return OK, 'recording', values

    def shutdown(self) -> None:
        """Finish the open bag."""
        if self._writer is not None:
            try:
                self.get_logger().info(self._close())
            except StageError as error:
                self._fail(error)


def main() -> None:
    """Run the node."""
    sys.exit(run(SessionRecorder))
