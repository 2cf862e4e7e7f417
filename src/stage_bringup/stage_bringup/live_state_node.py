"""What the page of the live view shows, gathered from the graph's messages."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, TransformStamped, Vector3, Vector3Stamped
from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger

from stage_core import topics
from stage_core.errors import StageError
from stage_core.frames import RigidTransform, alignment_in
from stage_core.quantities import AXES
from stage_core.ros.joint_state_wire import JointSample
from stage_core.ros.node import JointStateReader, StageNode
from stage_core.ros.peers import SILENCE

#: References that are kept: those of 0.4 s at 1 kHz, of the oldest encoder reading and younger.
KEPT = 400
#: A contour error is shown for so long (s).
FOLLOWING = 0.3
#: Wall time that the driver has to answer a stop (s).
STOP_TIMEOUT = 5.0
SILENT = 3


class LiveState:
    """The newest messages of a few topics, as one state for the page."""

    def __init__(self, node: StageNode) -> None:
        self._lock = threading.Lock()
        self._encoders: deque[JointSample] = deque(maxlen=8)
        self._references: deque[bytes] = deque(maxlen=KEPT)
        self._reader = JointStateReader()
        self._tracker: list[float] | None = None
        self._contour: tuple[Vector3, float] | None = None
        self._alignment = RigidTransform.identity()
        self._states: dict[str, tuple[int, str, float]] = {}
        self._log = node.get_logger()
        self._stop = node.create_client(Trigger, '/stage_driver/stop')

    def take(self, topic: str, data: bytes) -> None:
        """Read one raw message; topics that the page does not show are passed over."""
        if topic == topics.JOINT_STATES:
            with self._lock:
                sample = self._reader.read(data)
                if sample is not None and sample.position:
                    self._encoders.append(sample)
        elif topic == topics.TRACKER_POINT:
            p = deserialize_message(data, PointStamped).point
            self._tracker = self._alignment.apply((p.x, p.y, p.z)).tolist()
        elif topic == topics.CONTOUR_ERROR:
            self._contour = (deserialize_message(data, Vector3Stamped).vector, time.monotonic())
        elif topic == topics.ALIGNMENT:
            try:
                self._alignment = alignment_in(deserialize_message(data, TransformStamped))
            except StageError as error:
                self._log.warning(str(error))
        elif topic == topics.DIAGNOSTICS:
            now = time.monotonic()
            with self._lock:
                for status in deserialize_message(data, DiagnosticArray).status:
                    level = int.from_bytes(status.level, 'little')
                    self._states[status.name] = (level, status.message, now)

    def keep_reference(self, data: bytes) -> None:
        """Keep one raw reference, unread until an encoder reading asks for it."""
        with self._lock:
            self._references.append(data)

    def _error(self) -> list[float] | None:
        """Reference minus encoder of the newest tick of which both are here.

        At 30 mm/s a reference of the next tick would be off by 30 µm.
        """
        with self._lock:
            encoders = list(self._encoders)
            read = [self._reader.read(data) for data in self._references]
        found = {r.stamp: r.position for r in read if r is not None}
        for sample in reversed(encoders):
            wanted = found.get(sample.stamp)
            if wanted is not None and len(wanted) == len(sample.position):
                return [r - q for r, q in zip(wanted, sample.position, strict=True)]
        return None

    def _following(self) -> Vector3 | None:
        """The newest contour error; None after a run, of which it says nothing any more."""
        contour = self._contour
        return contour[0] if contour and time.monotonic() - contour[1] < FOLLOWING else None

    def now(self) -> dict[str, Any]:
        """The state of this moment; SI units."""
        with self._lock:
            position = list(self._encoders[-1].position) if self._encoders else None
            states = dict(self._states)
        latest, contour = time.monotonic(), self._following()
        rows = [
            {
                'name': name,
                'level': SILENT if latest - heard > SILENCE else level,
                'text': text,
            }
            for name, (level, text, heard) in sorted(states.items())
        ]
        # What is wrong comes first.
        rows.sort(key=lambda row: row['level'] == 0)
        driver = next((r['text'] for r in rows if r['name'] == 'stage_driver: state'), '')
        return {
            'axes': AXES,
            'position': _finite(position),
            # The controller's own: in real time the driver's reference is a tick late in a stream.
            'error': _finite([contour.x, contour.y] if contour else self._error()),
            'tracker': _finite(self._tracker),
            'contour': contour.z if contour and math.isfinite(contour.z) else None,
            'driver': driver,
            'states': rows,
        }

    def stop(self) -> str:
        """Ask the driver to stop and wait for its answer; a sentence for the page."""
        if not self._stop.service_is_ready():
            return 'No driver answers: use the emergency stop.'
        future, done = self._stop.call_async(Trigger.Request()), threading.Event()
        future.add_done_callback(lambda _: done.set())
        if not done.wait(STOP_TIMEOUT):
            return (
                f'The driver did not answer within {STOP_TIMEOUT:.0f} s: use the emergency stop.'
            )
        answer = future.result()
        return f'The driver answers: {answer.message}' if answer else 'The stop failed.'


def _finite(values: list[float] | None) -> list[float] | None:
    """The values, or None where one is no number: JSON has no word for that."""
    return values if values is not None and all(map(math.isfinite, values)) else None
