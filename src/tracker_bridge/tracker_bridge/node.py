"""Node `tracker_bridge`: a laser tracker's stream to /tracker/point, and its alignment."""

from __future__ import annotations

import sys
import threading
import time
from dataclasses import fields
from typing import Any

import rclpy
from geometry_msgs.msg import PointStamped, TransformStamped
from sensor_msgs.msg import JointState

from stage_core import topics
from stage_core.errors import StageError
from stage_core.ownership import Ownership, address
from stage_core.ros.batch_node import Batches
from stage_core.ros.node import (
    ERROR,
    LATCHED_QOS,
    OK,
    STATE_QOS,
    WARN,
    JointStateReader,
    StageNode,
    run,
    set_stamp,
)
from stage_core.ros.services_node import create_trigger_service
from tracker_bridge.bridge import CLOCK_LOST, Bridge, Limits
from tracker_bridge.complaints import Complaints
from tracker_bridge.parameters import PARAMETERS
from tracker_bridge.registration import register
from tracker_bridge.rest import RestPairs, RestRules
from tracker_bridge.sa_text import SaFormat
from tracker_bridge.samples import Sample
from tracker_bridge.sources.base import Source
from tracker_bridge.sources.emscon import EmsconSource
from tracker_bridge.sources.sa_text import SaTextSource

ALIGN_POLL = 0.05
# In lockstep a world that waits sends nothing: then everything has arrived.
QUIET_TIME = 0.4
ALIGN_TIMEOUT = 3.0


class TrackerBridge(StageNode):
    """Publishes tracker points as measured and answers `~/align` and `~/reset`."""

    def __init__(self, **options: Any) -> None:
        super().__init__('tracker_bridge', PARAMETERS, **options)
        self._lock = threading.Lock()
        self._reader = JointStateReader()
        value = self.value
        watched = {f.name: value(f'limits.{f.name}') for f in fields(Limits) if f.name != 'rate'}
        self._bridge = Bridge(
            Limits(value('rate'), **watched),
            'ros' if value('source') == 'replay' else value('source_clock'),
        )
        rules = {f.name: value(f'rest.{f.name}') for f in fields(RestRules)}
        self._pairs = RestPairs(RestRules(**rules))
        self._arrived = time.monotonic()
        self._alignment = ''
        self._owned: Ownership | None = None
        if value('source') != 'replay':
            wire = f'tracker connection {address(value("host"), value("port"))}'
            self._owned = Ownership(wire, 'tracker_bridge', 'give this bridge another port')
        self._source = self._make_source()
        self._points = self.create_publisher(PointStamped, topics.TRACKER_POINT, STATE_QOS)
        self._transforms = self.create_publisher(TransformStamped, topics.ALIGNMENT, LATCHED_QOS)
        self._batches = Batches(self)
        self._batches.create_subscription(JointState, topics.JOINT_STATES, self._on_joint_states)
        create_trigger_service(self, '~/align', self._align)
        create_trigger_service(self, '~/reset', self._reset)
        steady = rclpy.clock.Clock(clock_type=rclpy.clock.ClockType.STEADY_TIME)
        self._complaints = Complaints(time.monotonic())
        self.create_timer(1.0, self._complain, clock=steady)
        self.diagnostics.hardware_id = f'{value("source")} {value("host")}:{value("port")}'
        self.diagnostics.task('connection', self._connection_status)
        self.diagnostics.task('stream', self._stream_status)
        self.diagnostics.task('alignment', self._alignment_status)
        self._source.start()

    def _make_source(self) -> Source:
        value = self.value
        kind, host, port = value('source'), value('host'), value('port')
        if kind == 'emscon':
            separation = 1.0 / value('rate') if value('rate') else 0.01
            return EmsconSource(self._take, host, port, separation)
        if kind == 'sa_text':
            labels = value('sa.labels')
            if len(labels) != 3 or len(set(labels)) != 3:
                raise StageError('sa.labels must hold three different labels, for x, y and z')
            form = SaFormat(tuple(labels), value('sa.decimal_comma'), value('sa.unit'))
            return SaTextSource(self._take, host, port, form)
        # Reading bags loads more than the other sources need.
        from tracker_bridge.sources.replay import ReplaySource

        return ReplaySource(self._take, value('bag'), value('replay_rate'))

    def _take(self, sample: Sample) -> None:
        """Publish what a sample gives; called in the source's thread."""
        with self._lock:
            self._arrived = time.monotonic()
            accepted = self._bridge.process(sample)
            for stamp, point in accepted:
                self._pairs.add_point(stamp, point)
        for stamp, (x, y, z) in accepted:
            message = PointStamped()
            message.header.frame_id = topics.TRACKER_FRAME
            set_stamp(message.header, stamp)
            message.point.x, message.point.y, message.point.z = x, y, z
            self._points.publish(message)

    def _on_joint_states(self, data: bytes, _: dict[str, int]) -> None:
        sample = self._reader.read(data)
        if sample and sample.position and all(abs(value) < 1e6 for value in sample.position):
            with self._lock:
                self._arrived = time.monotonic()
                self._pairs.add_stage(sample.stamp, tuple(sample.position))

    def _align(self) -> str:
        self._until_arrived()
        with self._lock:
            self._check_streams()
            pairs = self._pairs.pairs()
        result = register([p.tracker for p in pairs], [p.stage for p in pairs])
        message = TransformStamped()
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = topics.STAGE_FRAME
        message.child_frame_id = topics.TRACKER_FRAME
        translation, rotation = message.transform.translation, message.transform.rotation
        translation.x, translation.y, translation.z = result.transform.translation.tolist()
        rotation.x, rotation.y, rotation.z, rotation.w = result.transform.quaternion().tolist()
        self._transforms.publish(message)
        self._alignment = result.summary()
        self.get_logger().info(self._alignment)
        return self._alignment

    def _check_streams(self) -> None:
        """Raise `StageError` when one of the two streams has never come."""
        if self._bridge.last_stamp is None:
            troubles = [self._source.trouble, *self._bridge.complaints()]
            reason = '; '.join(filter(None, troubles)) or 'wait two seconds for the clock offset'
            raise StageError(f'no tracker point has come yet: {reason}')
        if self._pairs.last_stage is None:
            raise StageError(f'nothing has come on {topics.JOINT_STATES}: start stage_driver')

    def _until_arrived(self) -> None:
        """Wait until both streams have passed the present time, or nothing comes any more.

        The executor is busy with the service meanwhile, so the joint states are taken here.
        """
        asked = self.now()
        # /clock waits for the executor too: simulated time is older here than what has come.
        simulated = bool(self.get_parameter('use_sim_time').value)
        deadline = time.monotonic() + ALIGN_TIMEOUT
        while time.monotonic() < deadline:
            self._batches.take()
            with self._lock:
                newest = (self._bridge.last_stamp or 0, self._pairs.last_stage or 0)
                quiet = time.monotonic() - self._arrived > QUIET_TIME
            if quiet or (min(newest) > asked and not simulated):
                return
            time.sleep(ALIGN_POLL)

    def _reset(self) -> str:
        with self._lock:
            self._pairs.clear()
            self._bridge.reset()
            self._source.new_session()
        return 'pairs and counters cleared'

    def _complain(self) -> None:
        trouble = self._source.trouble or (CLOCK_LOST if self._bridge.clock_lost else '')
        said = self._complaints.due(trouble, self._source.connected, time.monotonic())
        if said and trouble:
            self.get_logger().warning(said)
        elif said:
            self.get_logger().info(said)

    def _connection_status(self) -> tuple[bytes, str, dict[str, Any]]:
        source = self._source
        if not source.connected:
            return ERROR, source.trouble or 'not connected yet', source.counters
        return WARN if source.trouble else OK, source.trouble or 'connected', source.counters

    def _stream_status(self) -> tuple[bytes, str, dict[str, Any]]:
        with self._lock:
            self._bridge.look(self.now(), self._source.connected)
            complaints = self._bridge.complaints()
            values: dict[str, Any] = self._bridge.values()
        if isinstance(self._source, SaTextSource):
            quantum = self._source.decoder.quantum
            values['quantum'] = f'{quantum:.2e}'
            if self.value('limits.quantum') < quantum < 1.0:
                complaints.append(
                    f'numbers are displayed in steps of {quantum * 1e6:.1f} µm: '
                    'raise the decimals in SpatialAnalyzer'
                )
        return (WARN, '; '.join(complaints), values) if complaints else (OK, 'fine', values)

    def _alignment_status(self) -> tuple[bytes, str, dict[str, Any]]:
        with self._lock:
            values = {
                'rests': len(self._pairs),
                'rests_without_points': self._pairs.without_points,
            }
        return OK, self._alignment or 'not aligned yet', values

    def shutdown(self) -> None:
        """Leave the tracker."""
        self._source.stop()
        if self._owned is not None:
            self._owned.close()


def main() -> int:
    """Run the node."""
    return run(TrackerBridge)


if __name__ == '__main__':
    sys.exit(main())
