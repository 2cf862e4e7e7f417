"""Node `stage_twin`: one process that holds the plant and serves every emulated device."""

from __future__ import annotations

import sys
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from stage_core import topics
from stage_core.clocks import NANOSECONDS, split_stamp
from stage_core.drive_link import DEFAULT_PORT
from stage_core.errors import StageError
from stage_core.parameters import Parameter, Value
from stage_core.twin_file import TwinFile
from stage_node.node import ERROR, OK, WARN, StageNode, run
from stage_twin.emulators.drive import DriveSocket
from stage_twin.emulators.tracker import FAULTS, TrackerInstrument
from stage_twin.emulators.tracker_server import SaTextSender, TrackerServer
from stage_twin.loops import LockstepLoop, RealTimeLoop
from stage_twin.machine import ServoMachine

PARAMETERS = (
    Parameter('twin', '', 'YAML file of the emulated machine; empty: the nominal servo twin'),
    Parameter(
        'clock',
        'realtime',
        'who drives time: the wall clock, or the driver tick by tick',
        choices=('realtime', 'lockstep'),
        read_only=True,
    ),
    Parameter('drive_port', DEFAULT_PORT, 'UDP port of the drive link', minimum=0, maximum=65535),
    Parameter(
        'tracker_protocol',
        'emscon',
        'what the emulated tracker speaks: TPI over TCP, text datagrams, or nothing',
        choices=('emscon', 'sa_watch_window', 'sa_script', 'none'),
        read_only=True,
    ),
    Parameter(
        'tracker_port', 20700, 'TCP port served, or UDP port sent to', minimum=0, maximum=65535
    ),
    Parameter(
        'tracker_clock_offset',
        0.0,
        "tracker's clock minus the plant's",
        's',
        -1e8,
        2e8,
        read_only=True,
    ),
    Parameter('tracker_packet_points', 1, 'points per TPI packet', minimum=1, maximum=1000),
    Parameter(
        'tracker_fault',
        'none',
        'fault of the emulated tracker, may be set while it runs',
        choices=(*FAULTS, 'drop_clients'),
    ),
    Parameter(
        'pty_link',
        '',
        'stepper: symbolic link to the pseudo-terminal of the Zaber chain; empty: none',
        read_only=True,
    ),
    Parameter('seed', 0, "seed of the tracker's noise", minimum=0),
    Parameter('noise', True, 'whether the tracker is noisy'),
    Parameter('watchdog', 0.02, 'real time: no force for this long brakes', 's', 0.001, 10.0),
    Parameter(
        'lockstep_watchdog',
        2.0,
        'lockstep: no force for this long (wall clock) brakes a moving stage',
        's',
        0.05,
        600.0,
    ),
    Parameter('clock_interval', 1, 'lockstep: ticks between two /clock messages', minimum=1),
)


class StageTwin(StageNode):
    """The emulated stage and tracker behind their real wire protocols."""

    def __init__(self, **options: Any) -> None:
        super().__init__('stage_twin', PARAMETERS, **options)
        self.diagnostics.hardware_id = 'emulated stage'
        path = self.value('twin')
        twin = TwinFile.load(path) if path else TwinFile.nominal_servo()
        self._tracker: TrackerServer | SaTextSender | None = None
        # Everything is compiled before a socket opens: the first client meets a ready machine.
        machine = ServoMachine(twin, seed=self.value('seed'), noise=self.value('noise'))
        self._drive = DriveSocket(len(machine.axes), self.value('drive_port'))
        self._tracker = self._open_tracker(machine)
        self._loop = self._make_loop(machine)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.diagnostics.task('plant', self._plant_status)
        self.diagnostics.task('tracker', self._tracker_status)
        self._loop.start()
        self.get_logger().info(self._summary())

    def _open_tracker(self, machine: ServoMachine) -> TrackerServer | SaTextSender | None:
        protocol, port = self.value('tracker_protocol'), self.value('tracker_port')
        if protocol == 'none' or machine.twin.tracker is None:
            return None
        if protocol != 'emscon':
            return SaTextSender(port, protocol.removeprefix('sa_'))
        instrument = TrackerInstrument(
            clock_offset_ns=round(self.value('tracker_clock_offset') * NANOSECONDS),
            packet_points=self.value('tracker_packet_points'),
        )
        try:
            return TrackerServer(instrument, port)
        except StageError:
            self._drive.close()
            raise

    def _make_loop(self, machine: ServoMachine) -> LockstepLoop | RealTimeLoop:
        if self.value('clock') == 'realtime':
            return RealTimeLoop(machine, self._drive, self._tracker, self.value('watchdog'))
        self._clock_publisher = self.create_publisher(Clock, topics.CLOCK, QoSProfile(depth=10))
        return LockstepLoop(
            machine,
            self._drive,
            self._tracker,
            self._publish_clock,
            self.value('lockstep_watchdog'),
            self.value('clock_interval'),
        )

    def _publish_clock(self, stamp: int) -> None:
        seconds, nanoseconds = split_stamp(stamp)
        self._clock_publisher.publish(Clock(clock=Time(sec=seconds, nanosec=nanoseconds)))

    def _summary(self) -> str:
        tracker = 'no tracker'
        if isinstance(self._tracker, TrackerServer):
            tracker = f'tracker TPI on 127.0.0.1:{self._tracker.port}'
        elif self._tracker is not None:
            tracker = f'tracker text to 127.0.0.1:{self.value("tracker_port")}'
        return (
            f'{self.value("clock")}, drive link on 127.0.0.1:{self._drive.port}, {tracker}, '
            f'axes {" ".join(self._loop.machine.axes)}'
        )

    def parameters_changed(self, changed: dict[str, Value]) -> str | None:
        """Switch a tracker fault; everything else is read when the node starts."""
        for name in changed:
            if name != 'tracker_fault':
                return f'{name} is read at the start only: start stage_twin with it'
        if self._tracker is None:
            return 'there is no emulated tracker: start stage_twin with tracker_protocol'
        self._tracker.set_fault(str(changed['tracker_fault']))
        return None

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._loop.reset()
        response.message = 'at rest at 0' if response.success else 'the plant thread is not alive'
        return response

    def _plant_status(self) -> tuple[bytes, str, dict[str, Any]]:
        loop = self._loop
        values: dict[str, Any] = {
            'ticks': loop.ticks,
            'time': f'{loop.stamp / NANOSECONDS:.3f}',
            'late_forces': loop.late_forces,
            'braked_ticks': loop.braked,
            'refused_datagrams': self._drive.refused,
        }
        if isinstance(loop, RealTimeLoop):
            values['missed_ticks'] = loop.pacer.missed
            values['worst_lateness'] = f'{loop.pacer.worst:.6f}'
            values['pauses'] = loop.pacer.pauses
        if loop.failure is not None:
            return ERROR, f'the plant has stopped: {loop.failure}', values
        if not self._drive.connected:
            return WARN, 'waits for a driver on the drive link', values
        if loop.braking:
            return WARN, 'no force from the driver: dynamic braking', values
        return OK, 'running', values

    def _tracker_status(self) -> tuple[bytes, str, dict[str, Any]]:
        if self._tracker is None:
            return OK, 'no emulated tracker', {}
        values: dict[str, Any] = {'fault': self.value('tracker_fault')}
        if isinstance(self._tracker, TrackerServer):
            values['clients'] = self._tracker.clients
            values['dropped_clients'] = self._tracker.dropped_clients
        return OK, 'serving', values

    def shutdown(self) -> None:
        """Stop the plant and close the sockets."""
        self._loop.stop()
        if self._tracker is not None:
            self._tracker.close()
        self._drive.close()


def main() -> int:
    """Run the node."""
    return run(StageTwin)


if __name__ == '__main__':
    sys.exit(main())
