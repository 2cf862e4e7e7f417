"""Nodes as processes that tests kill, suspend and restart, and a client that watches them."""

from __future__ import annotations

import signal
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from stage_bringup.graph import Options, commands
from stage_bringup.processes import NodeCommand, Processes
from stage_core import topics
from stage_core.errors import StageError
from stage_core.ros.client_node import GraphClient
from stage_core.ros.node import LATCHED_QOS, SETPOINT_QOS, STATE_QOS, joint_state, stamp_of

from ..patience import PATIENCE

#: Rows of a stage at rest are this near to each other [m]; the noise of the tracker is 1 µm.
STANDS = 2e-5
#: Lines that a node's part of a failure has, at the end of its output.
TOLD = 6


class NodeEnded(Exception):
    """A node has ended by itself.

    No failure of an assertion: tests that try again what a busy machine upset must not go on.
    """


class Nodes(Processes):
    """The processes of a graph, which tests kill, suspend and start again by name."""

    def __init__(self, commands: Sequence[NodeCommand], folder: Path) -> None:
        super().__init__(folder)
        self.commands = {command.name: command for command in commands}
        #: Cleared where the graph no longer answers, so that the next test need not wait.
        self.usable = True
        self._killed: set[str] = set()

    def run(self, *names: str) -> None:
        """Start nodes, all of them if none is named."""
        for name in names or tuple(self.commands):
            self._killed.discard(name)
            self.start(self.commands[name])

    def signal(self, name: str, number: int) -> None:
        """Send a signal; SIGKILL waits until the process is gone."""
        process = self.running[name]
        if number == signal.SIGKILL:
            self._killed.add(name)
        process.send_signal(number)
        if number == signal.SIGKILL:
            process.wait()

    def kill(self, name: str) -> None:
        """kill -9."""
        self.signal(name, signal.SIGKILL)

    def log(self, name: str) -> str:
        """Everything a node has printed."""
        return (self.log_folder / f'{name}.log').read_text(errors='replace')

    def told(self) -> str:
        """The last lines of every node's output."""
        return '\n'.join(f'--- {name}:\n{self._last_lines(name)}' for name in self.running)

    def _last_lines(self, name: str) -> str:
        lines = [line for line in self.log(name).splitlines() if line.strip()]
        return '\n'.join(lines[-TOLD:]) or 'no output'

    def alive(self) -> None:
        """Check that no node has ended but those that a test killed.

        Raises
        ------
        NodeEnded
            With exit status and last lines of each that has.
        """
        ended = [
            f'{name} ended with status {process.returncode}:\n{self._last_lines(name)}'
            for name, process in self.running.items()
            if name not in self._killed and process.poll() is not None
        ]
        if ended:
            raise NodeEnded('\n'.join(ended))

    def dead(self) -> list[str]:
        """Names of the processes that have ended."""
        return [name for name, process in self.running.items() if process.poll() is not None]


class Watch:
    """A client of the graph that keeps what the stage did, by stamp.

    `lean` keeps the encoder only: four more topics at 1 kHz are a load of their own. Waiting for
    what `nodes` do ends where one of them has ended.
    """

    def __init__(self, lockstep: bool, lean: bool = False, nodes: Nodes | None = None) -> None:
        self._nodes = nodes
        self.client = GraphClient('reliability', use_sim_time=lockstep)
        self.states: dict[str, tuple[bytes, str, dict[str, str], float]] = {}
        #: Rows (stamp [ns], x, y): encoder [m], tracker [m], velocity command [m/s], set-points.
        self.encoder: deque[tuple[int, float, float]] = deque(maxlen=700_000)
        self.tracker: deque[tuple[int, float, float]] = deque(maxlen=50_000)
        self.command: deque[tuple[int, float, float]] = deque(maxlen=200_000)
        self.reference: deque[tuple[int, float, float]] = deque(maxlen=200_000)
        #: Stamps [ns] of the set-points that held finite velocities, and the tick that was the
        #: newest when the last one came: on a busy machine a controller stamps old states.
        self.streamed: deque[int] = deque(maxlen=50_000)
        self.streamed_at = 0
        client = self.client
        client.watch(DiagnosticArray, topics.DIAGNOSTICS, 10, self._on_diagnostics)  # type: ignore[arg-type]
        client.watch(JointState, topics.JOINT_STATES, STATE_QOS, self._keeper(self.encoder))
        client.watch(String, topics.MODEL, LATCHED_QOS)
        if not lean:
            client.watch(JointState, topics.REFERENCE, STATE_QOS, self._keeper(self.reference))
            velocities = self._keeper(self.command, 'velocity')
            client.watch(JointState, topics.COMMAND, STATE_QOS, velocities)
            client.watch(PointStamped, topics.TRACKER_POINT, STATE_QOS, self._on_point)
            client.watch(JointState, topics.SETPOINT, STATE_QOS, self._on_setpoint)
        make = client.node.create_publisher
        self.setpoints = make(JointState, topics.SETPOINT, SETPOINT_QOS)
        self.targets = make(JointState, topics.TARGET, SETPOINT_QOS)
        self._moves = 0

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        now = time.monotonic()
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            self.states[status.name] = (status.level, status.message, values, now)

    def _on_setpoint(self, message: JointState) -> None:
        if len(message.velocity) and np.isfinite(message.velocity).all():
            self.streamed.append(stamp_of(message.header))
            self.streamed_at = self.encoder[-1][0] if self.encoder else 0

    @staticmethod
    def _keeper(rows: deque, field: str = 'position') -> Callable[[JointState], None]:
        def keep(message: JointState) -> None:
            values = getattr(message, field)
            # Tests publish rubbish too.
            if len(values) > 1:
                rows.append((stamp_of(message.header), values[0], values[1]))

        return keep

    def _on_point(self, message: PointStamped) -> None:
        self.tracker.append((stamp_of(message.header), message.point.x, message.point.y))

    def says(self, status: str, *words: str) -> Callable[[], bool]:
        """Condition: the newest status of that name holds one of the words."""

        def found() -> bool:
            return any(word in self.text(status) for word in words)

        return found

    def missed(self, node: str) -> Callable[[], bool]:
        """Condition: one of the others says that a node fell silent."""

        def found() -> bool:
            return any(
                name.endswith(': peers') and node in state[1]
                for name, state in list(self.states.items())
            )

        return found

    def text(self, status: str) -> str:
        """Message of a status; empty while it is unknown."""
        return self.states.get(status, (b'', '', {}, 0.0))[1]

    def value(self, status: str, key: str) -> str:
        """A value of a status; empty while it is unknown."""
        return self.states.get(status, (b'', '', {}, 0.0))[2].get(key, '')

    def wait(self, condition: Callable[[], bool], what: str, timeout: float = PATIENCE) -> None:
        """Wait for a condition; the failure tells every status and each node's last lines."""

        def holds() -> bool:
            # Asked first: what a node did before its end may be what is waited for.
            if condition():
                return True
            self._alive()
            return False

        try:
            self.client.wait_for(holds, timeout, what, poll=0.01)
        except StageError as error:
            raise AssertionError(f'{error}; {self._known()}') from error

    def _alive(self) -> None:
        if self._nodes is not None:
            self._nodes.alive()

    def _known(self) -> str:
        known = {name: state[1:3] for name, state in self.states.items()}
        return f'statuses: {known}\n{self._nodes.told() if self._nodes is not None else ""}'

    def move(self, x: float, y: float) -> None:
        """Publish a position set-point [m]."""
        self._moves += 1
        stamp = max(self.client.node.get_clock().now().nanoseconds, 0) + self._moves
        self.setpoints.publish(joint_state(stamp, ('x', 'y'), position=(x, y)))

    def move_until_moving(self, x: float, y: float) -> None:
        """Start a move and wait until the stage is well under way."""
        begin = self.encoder[-1]
        self.move(x, y)
        self.wait(lambda: abs(self.encoder[-1][1] - begin[1]) > 0.004, 'motion')

    def arrived(self, x: float, y: float, within: float = 1e-4) -> Callable[[], bool]:
        """Condition: the encoder has stayed near a point for 50 ticks."""

        def there() -> bool:
            rows = last(self.encoder, 50)
            return len(rows) == 50 and all(
                abs(row[1] - x) < within and abs(row[2] - y) < within for row in rows
            )

        return there

    def streamed_time(self) -> float:
        """Stage time covered by the stream since `streamed` was cleared [s]."""
        return 1e-9 * (self.streamed[-1] - self.streamed[0]) if self.streamed else 0.0

    def home(self) -> None:
        """Reset what is latched, enable, home; the failure tells every status."""
        try:
            self.client.wait_for_service('/stage_driver/reset_fault', PATIENCE, self._alive)
            self.client.trigger('/stage_driver/reset_fault', PATIENCE)
            self.client.set_bool('/stage_driver/enable', True, PATIENCE)
            self.client.trigger('/stage_driver/home', PATIENCE)
        except StageError as error:
            self._alive()
            raise AssertionError(f'{error}; {self._known()}') from error

    def silent(
        self, rows: deque, seconds: float = 0.5, also: Callable[[], bool] = lambda: True
    ) -> None:
        """Wait until no row has come for a while (lockstep: a quiet world) and `also` holds."""
        seen = [len(rows), rows[-1] if rows else None, time.monotonic()]

        def quiet() -> bool:
            now: list[Any] = [len(rows), rows[-1] if rows else None]
            if now != seen[:2]:
                seen[:] = [*now, time.monotonic()]
            return time.monotonic() - float(seen[2]) > seconds and also()  # type: ignore[arg-type]

        self.wait(quiet, 'silence')

    def rest(self, rows: deque, seconds: float = 0.5, count: int = 20) -> None:
        """Wait until the record is silent and its newest rows are the same place.

        Silence alone is no rest: on a busy machine the plant may be silent in full motion.
        """
        self.silent(
            rows, seconds, lambda: len(rows) >= count and spread(last(rows, count)) < STANDS
        )

    def heard(self, node: str) -> bool:
        """Whether a node has spoken on /diagnostics."""
        return any(name.startswith(f'{node}:') for name in list(self.states))

    def forget(self, *nodes: str) -> None:
        """Forget what nodes have said: `heard` is then about those that are started again."""
        for name in list(self.states):
            if name.partition(':')[0] in nodes:
                del self.states[name]

    def close(self) -> None:
        """Leave the graph."""
        self.client.close()


@contextmanager
def running(
    options: Options, *names: str, lean: bool = False, **parameters: Mapping[str, object]
) -> Iterator[tuple[Nodes, Watch]]:
    """The graph of `options`, or some of its nodes, with parameters per node, and its watcher."""
    chosen = [
        replace(command, parameters={**command.parameters, **parameters.get(command.name, {})})
        for command in commands(options)
        if not names or command.name in names
    ]
    nodes = Nodes(chosen, options.out.with_name('log'))
    watch = None
    try:
        nodes.run()
        watch = Watch(options.clock == 'lockstep', lean, nodes)
        yield nodes, watch
    finally:
        if watch is not None:
            watch.close()
        nodes.end()


def restart(nodes: Nodes, watch: Watch, *names: str) -> None:
    """Start nodes again and wait until each speaks.

    Before that a call may go to the one that was killed: discovery forgets it after 20 s.
    """
    watch.forget(*names)
    for name in names:
        nodes.run(name)
    for name in names:
        watch.wait(lambda name=name: watch.heard(name), f'{name} joins again')  # type: ignore[misc]


def last(rows: deque, count: int) -> list:
    """The newest rows, fewer where there are not so many; cheap however long the record is."""
    # While they are read one more may come: then the oldest of these are skipped.
    return [rows[-k] for k in range(min(count, len(rows)), 0, -1)]


def spread(rows: Sequence[tuple[int, float, float]]) -> float:
    """Largest extent of rows [m]."""
    return float(np.ptp(np.array(rows)[:, 1:], axis=0).max())
