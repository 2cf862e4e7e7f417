"""What every node that streams set-points shares: from encoder to set-point, and timing."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from concurrent.futures import Future
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3Stamped
from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from contour_ctrl.joined import Joined
from contour_ctrl.sequence import ContourRun, SetPoint, compile_kernels
from contour_ctrl.tick import CONTOUR, EX
from stage_core import topics
from stage_core.errors import StageError
from stage_core.parameters import Parameter
from stage_core.quantities import AXES
from stage_core.ros.joint_state_wire import JointSample, JointStateLayout
from stage_core.ros.node import (
    OK,
    SETPOINT_QOS,
    STATE_QOS,
    WARN,
    JointStateReader,
    StageNode,
    set_stamp,
)

#: Lockstep: without a message for this wall time the world stands still [s].
QUIET_TIME = 0.5
#: The node that takes the set-points.
DRIVER = 'stage_driver'
#: Without a first message of the encoder for this wall time no run starts [s].
FIRST_MESSAGE_TIMEOUT = 10.0

#: Real time: a controller that is behind leaves out what is older, as a set-point for it would
#: look like a following error. 5 ms are 1 mm at the default speed limit; 2 mm are a fault.
FRESH_QOS = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)


class StreamingNode(StageNode):
    """Feeds encoder messages to a `ContourRun` and publishes what it answers.

    The set-point goes out in the subscription's callback, before anything else is done.
    """

    def __init__(self, name: str, parameters: Sequence[Parameter]) -> None:
        super().__init__(name, parameters)
        compile_kernels()
        self.course: ContourRun | None = None
        self._answer: Future[str] | None = None
        self._arrived = time.monotonic()
        self._indices: tuple[int, int] | None = None
        self._jitter = np.zeros(4096)
        self._jitter_count = 0
        self._missed_before = 0
        self._first_seen = False
        self._begun = False
        #: How often the driver has stopped the stage, as far as it is known.
        self._stops: int | None = None
        self._costs = np.zeros(4096)
        self._reader = JointStateReader()
        self._both = JointStateLayout(topics.STAGE_FRAME, AXES, (2, 2, 0))
        self._position_only = JointStateLayout(topics.STAGE_FRAME, AXES, (2, 0, 0))
        self._error = Vector3Stamped()
        self._error.header.frame_id = topics.STAGE_FRAME
        #: Of the run: executor, and where the driver is in this process its thread.
        self._lock = threading.RLock()
        #: A driver in this process, and what stands between the two.
        self._driver: Any = None
        self._joined: Joined | None = None
        self._setpoints = self.create_publisher(JointState, topics.SETPOINT, SETPOINT_QOS)
        self._errors = self.create_publisher(Vector3Stamped, topics.CONTOUR_ERROR, STATE_QOS)
        waiting = STATE_QOS if self.lockstep else FRESH_QOS
        self._states = self.create_subscription(
            JointState, topics.JOINT_STATES, self._on_state, waiting, raw=True
        )
        # Virtual time stands still in lockstep: the guard runs on the machine's own clock.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(0.05, self._watch, clock=clock)
        self.diagnostics.task('timing', self._timing_status)

    @property
    def lockstep(self) -> bool:
        """Whether time is simulated; then identical runs give identical results."""
        return bool(self.get_parameter('use_sim_time').value)

    def join(self, driver: Any) -> None:
        """Work with a `StageDriver` of this process: without the topics between the two."""
        self.destroy_subscription(self._states)
        self._driver = driver
        self._joined = Joined(driver.axes, self._lock, self._prompt, self._on_sample)
        driver.join(self._joined)

    def _prompt(self, stamp: int) -> bool:
        return self.course is None or self.course.prompt(stamp)

    def begin(self, course: ContourRun, answer: Future[str] | None = None) -> Future[str]:
        """Start a run; the future, `answer` or a new one, holds its message or its StageError."""
        given: Future[str] = Future() if answer is None else answer
        with self._lock:
            self.course, self._answer = course, given
            self._arrived = time.monotonic()
            self._first_seen = False
            self._missed_before = 0
            self._begun = False
        self._watch()
        return given

    def stop_run(self, reason: str) -> None:
        """Stop the run smoothly."""
        with self._lock:
            if self.course is not None:
                self._publish(self.course.abort(reason))
                self._conclude()

    def run_ended(self, course: ContourRun) -> None:
        """Hook: called once when a run is over, before it is answered."""

    def silence_limit(self) -> float:
        """Silence of the encoder that ends a run [s] of wall time."""
        return float(self.value('lockstep_timeout')) if self.lockstep else 0.5

    def node_spoke(self, node: str, data: bytes) -> None:
        """End a run at once of which the driver refused a set-point, or that it has stopped."""
        if node != DRIVER:
            return
        for status in deserialize_message(data, DiagnosticArray).status:
            values = {pair.key: pair.value for pair in status.values}
            if 'stops' in values:
                with self._lock:
                    self._driver_spoke(values)

    def _driver_spoke(self, values: dict[str, str]) -> None:
        """What the driver says of set-points and stops; with the lock."""
        before, self._stops = self._stops, int(values['stops'])
        stamp, refusal = values.get('refused_stamp', ''), values.get('last_refusal', '')
        if stamp and self.course is not None and self.course.awaits(int(stamp)):
            self.driver_stopped(refusal.replace('~/', f'/{DRIVER}/'))
        elif before not in (None, self._stops):
            self.driver_stopped(f'the driver has stopped the stage: {values.get("last_stop", "")}')

    def driver_stopped(self, reason: str) -> None:
        """End the run, if there is one; with the lock."""
        if self.course is not None:
            self.course.end(reason)
            self._conclude()

    def _on_state(self, data: bytes) -> None:
        if self.course is None or not self._begun:
            return
        message = self._reader.read(data)
        if message is not None:
            with self._lock:
                self._on_sample(message)

    def _on_sample(self, message: JointSample) -> None:
        """Answer a measurement; with the lock."""
        now = time.monotonic()
        course = self.course
        if course is None or not self._begun:
            return
        if self._indices is None:
            self._indices = _axis_places(message.names)
            if self._indices is None:
                self._fault(
                    f'{topics.JOINT_STATES} names the axes {list(message.names)}, x and y are '
                    'needed: see the parameter axes of the driver'
                )
                return
        place_x, place_y = self._indices
        if len(message.position) <= max(place_x, place_y):
            self._fault(f'{topics.JOINT_STATES} holds no position for each axis')
            return
        point = course.on_state(
            message.stamp, message.position[place_x], message.position[place_y]
        )
        self._publish(point)
        if point is not None and point.velocity is not None:
            self._publish_error(course, message.stamp)
            slot = self._jitter_count % len(self._jitter)
            self._jitter[slot] = now - self._arrived
            self._costs[slot] = time.monotonic() - now
            self._jitter_count += 1
        self._arrived = now
        self._first_seen = True
        if course.done:
            self._conclude()

    def _publish(self, point: SetPoint | None) -> None:
        if point is None:
            return
        if point.velocity is None:
            data = self._position_only.encode(point.stamp, point.position)
        else:
            data = self._both.encode(point.stamp, point.position, point.velocity)
        if self._joined is None:
            self._setpoints.publish(data)
            return
        sample = JointSample(point.stamp, AXES, point.position, point.velocity or ())
        self._driver.take(sample, data)
        self._joined.publish(self._setpoints, data)

    def _publish_error(self, course: ContourRun, stamp: int) -> None:
        row = course.newest_record()
        set_stamp(self._error.header, stamp)
        vector = self._error.vector
        vector.x, vector.y, vector.z = float(row[EX]), float(row[EX + 1]), float(row[CONTOUR])
        if self._joined is None:
            self._errors.publish(self._error)
        else:
            self._joined.publish(self._errors, self._error)

    def _watch(self) -> None:
        """Guard: silence starts a contour in lockstep, and ends a run where it is a loss."""
        course = self.course
        if course is None:
            return
        silence = time.monotonic() - self._arrived
        limit = self.silence_limit()
        if not self._first_seen:
            limit = max(limit, FIRST_MESSAGE_TIMEOUT)
        # A run that goes on is left alone: whoever answers its ticks must not find it locked.
        if not self._first_seen or course.waits_for_quiet or silence > limit:
            with self._lock:
                self._guard_run(course, silence, limit)

    def _guard_run(self, course: ContourRun, silence: float, limit: float) -> None:
        if self.course is not course:
            return
        if not self._begun:
            # A set-point that nobody has subscribed to yet would be lost.
            if self._stage_listens():
                self._begun = True
                self._arrived = time.monotonic()
                self._publish(course.begin(self.get_clock().now().nanoseconds))
            elif silence > FIRST_MESSAGE_TIMEOUT:
                self._fault(f'nobody listens to {topics.SETPOINT}: is stage_driver running?')
        elif course.waits_for_quiet:
            if silence > QUIET_TIME:
                self._publish(course.world_is_quiet())
        elif silence > limit:
            course.end(course.silence(silence))
            self._conclude()

    def _stage_listens(self) -> bool:
        """Whether the node that says where the axes are takes set-points: no recorder alone."""
        listeners = self.get_subscriptions_info_by_topic(topics.SETPOINT)
        stages = self.get_publishers_info_by_topic(topics.JOINT_STATES)
        named = [
            {(at.node_namespace, at.node_name) for at in found} for found in (listeners, stages)
        ]
        return self._setpoints.get_subscription_count() > 0 and not named[0].isdisjoint(named[1])

    def _fault(self, reason: str) -> None:
        with self._lock:
            if self.course is not None:
                self._publish(self.course.fault(self.get_clock().now().nanoseconds, reason))
                self._conclude()

    def _conclude(self) -> None:
        course, answer = self.course, self._answer
        if course is None or answer is None or not course.done:
            return
        self.course = self._answer = None
        try:
            self.run_ended(course)
        except StageError as error:
            answer.set_exception(error)
            return
        if course.success:
            self.get_logger().info(course.message)
            answer.set_result(course.message)
        else:
            self.get_logger().error(course.message)
            answer.set_exception(StageError(course.message))

    def _timing_status(self) -> tuple[bytes, str, dict[str, Any]]:
        count = min(self._jitter_count, len(self._jitter))
        if count == 0:
            return OK, 'no ticks yet', {}
        missed = self.course.missed if self.course is not None else self._missed_before
        intervals, costs = 1e3 * self._jitter[:count], 1e6 * self._costs[:count]
        values = {
            'ticks': self._jitter_count,
            'missed_ticks': missed,
            'interval_median_ms': f'{np.median(intervals):.3f}',
            'interval_p99_ms': f'{np.percentile(intervals, 99):.3f}',
            'interval_max_ms': f'{intervals.max():.3f}',
            'callback_median_us': f'{np.median(costs):.0f}',
            'callback_p99_us': f'{np.percentile(costs, 99):.0f}',
            'scheduling': self.scheduling,
        }
        if missed:
            return WARN, f'{missed} ticks missed', values
        return OK, 'every tick answered', values


def _axis_places(names: Sequence[str]) -> tuple[int, int] | None:
    found = {name: index for index, name in enumerate(names)}
    if not all(axis in found for axis in AXES):
        return None
    return found[AXES[0]], found[AXES[1]]
