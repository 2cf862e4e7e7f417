"""What a session does with the graph: drive to a target, wait for rest, read the tracker."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, TransformStamped
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from stage_core import topics
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.frames import RigidTransform, alignment_in
from stage_core.patience import Patience
from stage_core.quantities import AXES
from stage_core.rests import Standstill
from stage_core.ros.batch_node import Batches
from stage_core.ros.client_node import GraphClient
from stage_core.ros.joint_state_wire import JointSample
from stage_core.ros.node import (
    LATCHED_QOS,
    SETPOINT_QOS,
    STATE_QOS,
    JointStateReader,
    joint_state,
    stamp_of,
)

#: The encoder counts as at rest while it stays within this band [m].
REST_BAND = 4.0e-6
#: So near to its reference [m] the stage has arrived.
ARRIVED = 1.0e-4
#: In lockstep the world waits this long [ns] after the dwell's last reference; a set-point that
#: came sooner would start its move a tick sooner on one run than on another.
STANDSTILL = 2_000_000
STANDSTILL_SILENCE = 1.0
#: The tracker's newest point is at most this old [ns]: three periods at 100 Hz.
UNDER_WAY = 30_000_000
#: A reference further from its target [m] than any correction belongs to another move.
LARGEST_CORRECTION = 2.0e-3
#: Between two looks at what came with every tick [s of wall time]. Message by message this process
#: took 25 s of processor time for a session, so it takes 14 s.
BATCH_PERIOD = 0.01
#: A set-point that got lost is sent again after this wall time without an answer [s].
RESEND = 5.0


class SessionClient(GraphClient):
    """The graph client of a session: follows reference, encoder and tracker by their stamps.

    `counted`: the positions are a stepper's counted motion, which stands still at rest.
    """

    def __init__(self, settle_time: float, use_sim_time: bool, counted: bool = False) -> None:
        super().__init__('session', use_sim_time)
        self._counted = counted
        self.settle_time = settle_time
        # In lockstep the driver's own dwell is the rule: nothing may depend on what an encoder
        # count does in its last milliseconds.
        self._lockstep = use_sim_time
        self._last_stamp = 0
        self._last_target_stamp = 0
        self._reference_since = 0
        self._rest_since = 0
        self._rest = Standstill(0.0 if counted else REST_BAND)
        self._reference = Standstill(0.0)
        self._points: deque[tuple[int, float, float, float]] = deque(maxlen=4000)
        self._targets = self.node.create_publisher(JointState, topics.TARGET, SETPOINT_QOS)
        self._batches = Batches(self.node, period=BATCH_PERIOD)
        self._follow(topics.REFERENCE, self._on_reference)
        self._follow(topics.JOINT_STATES, self._on_state)
        self.watch(PointStamped, topics.TRACKER_POINT, STATE_QOS, self._on_point)
        self.watch(TransformStamped, topics.ALIGNMENT, LATCHED_QOS)
        self.watch(String, topics.MODEL, LATCHED_QOS)
        self._status: dict[str, tuple[str, dict[str, str]]] = {}
        self.watch(DiagnosticArray, topics.DIAGNOSTICS, 10, self._on_diagnostics)

    def _follow(self, topic: str, callback: Callable[[JointSample], None]) -> None:
        """Watch JointStates that come with every tick."""
        reader = JointStateReader()

        def taken(data: bytes, _: dict[str, int]) -> None:
            if (sample := reader.read(data)) is not None:
                callback(sample)
                self._came(topic, sample)

        self._batches.create_subscription(JointState, topic, taken)

    def _on_reference(self, sample: JointSample) -> None:
        if self._reference.moved(sample.position):
            self._reference_since = sample.stamp

    def _on_state(self, sample: JointSample) -> None:
        self._last_stamp = sample.stamp
        if self._rest.moved(sample.position):
            self._rest_since = self._last_stamp

    def _on_point(self, message: PointStamped) -> None:
        p = message.point
        self._points.append((stamp_of(message.header), p.x, p.y, p.z))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            self._status[status.name] = (status.message, values)

    @property
    def connected(self) -> bool:
        """Whether the bridge has a tracker."""
        return self.status('tracker_bridge: connection')[0] == 'connected'

    def status(self, task: str) -> tuple[str, dict[str, str]]:
        """Newest sentence and values of a task on /diagnostics, named ``node: task``."""
        return self._status.get(task, ('', {}))

    def progress(self) -> object:
        """In lockstep the stamp of the encoder: simulated time goes on, however slowly."""
        return self._last_stamp if self._lockstep else None

    def alignment(self) -> RigidTransform:
        """The transform that the bridge has published last; identity before."""
        message = self.latest(topics.ALIGNMENT)
        return RigidTransform.identity() if message is None else alignment_in(message)

    def go_to(self, target: Array, timeout: float, alive: Callable[[], None]) -> int:
        """Drive to a table position (2,) [m] and wait until the stage rests there.

        `alive` is called while waiting and raises when a node has ended. Returns the stamp [ns]
        at which the rest has lasted the settle time.

        Raises
        ------
        StageError
            Without rest after `timeout` [s]: of wall time; in lockstep, where a busy machine is
            slow, of simulated time, or of wall time in which simulated time stood still.
        """
        settle = int(self.settle_time * 1e9)
        sent = self._last_stamp
        stamp = max(self.node.get_clock().now().nanoseconds, self._last_target_stamp + 1)
        self._last_target_stamp = stamp
        message = joint_state(stamp, AXES, position=[float(v) for v in target])

        def at_rest() -> bool:
            if self._last_stamp <= sent or not self._reference.position:
                return False
            moved = self._rest_since if self._counted else 0
            dwelt = self._last_stamp - max(self._reference_since, moved, sent)
            if self._lockstep and not self._counted and dwelt < settle + STANDSTILL:
                # A move of no length ends a tick or two sooner: then only silence tells.
                silent = self.silence(topics.JOINT_STATES)
                return dwelt >= settle - STANDSTILL and silent > STANDSTILL_SILENCE
            if dwelt < settle:
                return False
            reference = np.array(self._reference.position)
            if np.abs(reference - target).max() > LARGEST_CORRECTION:
                return False
            if self._lockstep:
                return True
            arrived = np.abs(np.array(self._rest.position) - reference).max() < ARRIVED
            return bool(arrived) and self._last_stamp - self._rest_since >= settle

        self._targets.publish(message)
        patience, published = Patience(timeout, self.progress), time.monotonic()
        while not at_rest():
            stuck = patience.left() <= 0.0
            if stuck or (self._lockstep and self._last_stamp - stamp > timeout * 1e9):
                raise StageError(self._restless(target, timeout, stuck))
            if self._unanswered(published) >= RESEND:
                self._targets.publish(message)
                published = time.monotonic()
            alive()
            self.comes(at_rest, Patience(0.5), poll=0.01)
        return self._last_stamp

    def _unanswered(self, published: float) -> float:
        """Wall time without an answer to what was published at a time [s].

        In lockstep the stage moves, however slowly, once it has a target.
        """
        waited = time.monotonic() - published
        return min(waited, self.silence(topics.JOINT_STATES)) if self._lockstep else waited

    def _restless(self, target: Array, timeout: float, stuck: bool) -> str:
        """Why a move to a target (2,) [m] is given up, and what the driver said last."""
        why = f'within {timeout:.0f} s'
        if self._lockstep:
            why = f'{why} of simulated time'
            if stuck:
                why = f'while simulated time stood still for {timeout:.0f} s'
        said = self.status('stage_driver: state')[0] or 'nothing'
        place = np.round(target * 1e3, 3)
        return f'the stage did not come to rest at {place} mm {why}; the driver said last: {said}'

    def measure(self, until: int, window: float, timeout: float) -> Array:
        """Mean tracker point over a `window` [s] that ends near stamp `until` [ns], (3,) raw [m].

        Raises
        ------
        StageError
            If the tracker sent fewer than three points in that time.
        """
        # The newest points may still be under way: the window ends where one is sure to come, so
        # that the same points are taken on every run.
        until -= UNDER_WAY
        begin = until - int(window * 1e9)
        self.wait_for(
            lambda: bool(self._points) and self._points[-1][0] >= until,
            timeout,
            'a tracker point of the position',
            poll=0.01,
        )
        inside = [p[1:] for p in list(self._points) if begin <= p[0] <= until]
        if len(inside) < 3:
            raise StageError(
                'the tracker sent fewer than three points while the stage was at rest: '
                'check its beam and its rate'
            )
        return np.mean(np.array(inside), axis=0)

    def parameter(self, node: str, name: str) -> Any:
        """Value of a parameter of another node."""
        request = GetParameters.Request(names=[name])
        response = self.call(GetParameters, f'{node}/get_parameters', request, 10.0)
        return parameter_value_to_python(response.values[0])
