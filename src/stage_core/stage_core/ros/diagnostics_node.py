"""The diagnostics of a node: one status per task."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from stage_core import topics
from stage_core.clocks import split_stamp
from stage_core.ros.peers import process_name

#: A diagnostic task returns (level, message, values).
DiagnosticTask = Callable[[], tuple[bytes, str, dict[str, Any]]]


class Diagnostics:
    """Publishes one status per task on /diagnostics, once a second of wall time."""

    def __init__(self, node: Any, hardware_id: str) -> None:
        self.hardware_id = hardware_id
        self._node = node
        self._tasks: dict[str, DiagnosticTask] = {}
        self._process = process_name()
        self._publisher = node.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, 10)
        # A steady clock: replayed or stalled time must not silence the diagnostics.
        clock = rclpy.clock.Clock(clock_type=rclpy.clock.ClockType.STEADY_TIME)
        node.create_timer(1.0, self.publish, clock=clock)

    def task(self, name: str, function: DiagnosticTask) -> None:
        """Add a task; its status is named ``node: name``."""
        self._tasks[name] = function

    def publish(self) -> None:
        """Publish the status of every task now."""
        message = DiagnosticArray()
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = split_stamp(self._node.now())
        message.header.frame_id = self._process
        for name, function in self._tasks.items():
            level, text, values = function()
            message.status.append(
                DiagnosticStatus(
                    level=level,
                    name=f'{self._node.get_name()}: {name}',
                    message=text,
                    hardware_id=self.hardware_id,
                    values=[KeyValue(key=str(k), value=str(v)) for k, v in values.items()],
                )
            )
        self._publisher.publish(message)
