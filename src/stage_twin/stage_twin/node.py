"""Node `stage_twin`: one process that holds the plant and serves every emulated device."""

from __future__ import annotations

import sys
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

from stage_core import topics
from stage_core.clocks import NANOSECONDS, split_stamp
from stage_core.drive_link import DEFAULT_PORT
from stage_core.errors import StageError
from stage_core.parameters import THREAD_PRIORITY, Parameter, Value
from stage_core.ros.node import ERROR, OK, WARN, StageNode, run
from stage_core.ros.services_node import create_trigger_service
from stage_core.twin_file import TwinFile
from stage_twin.emulators.drive import DriveSocket
from stage_twin.emulators.tracker import FAULTS, TrackerInstrument
from stage_twin.emulators.tracker_server import SaTextSender, TrackerServer
from stage_twin.loops import LockstepLoop, RealTimeLoop
from stage_twin.machine import ServoMachine
from stage_twin.stepper_loop import StepperLoop

SWITCH_INTERVAL = 2e-4

PARAMETERS = (
    Parameter('twin', '', 'YAML file of the emulated machine; empty: the nominal servo twin'),
    Parameter(
        'engine',
        'kernel',
        "what moves the stage: the twin file's plant, or the MuJoCo model `model`",
        choices=('kernel', 'mujoco'),
        read_only=True,
    ),
    Parameter('model', '', 'MJCF file of engine mujoco', read_only=True),
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
        8.0,
        'lockstep: no force for this long (wall clock) brakes a moving stage; longer than the '
        "driver's own timeout",
        's',
        0.05,
        600.0,
    ),
    Parameter('clock_interval', 1, 'lockstep: ticks between two /clock messages', minimum=1),
    THREAD_PRIORITY,
)


class StageTwin(StageNode):
    """The emulated stage and tracker behind their real wire protocols."""

    def __init__(self, **options: Any) -> None:
        super().__init__('stage_twin', PARAMETERS, **options)
        self.diagnostics.hardware_id = 'emulated stage'
        path = self.value('twin')
        twin = TwinFile.load(path, with_gains=True) if path else TwinFile.nominal_servo()
        self._tracker: TrackerServer | SaTextSender | None = None
        self._clock_publisher: Publisher | None = None
        self._simulated = 0
        if self.value('clock') == 'lockstep':
            self._clock_publisher = self.create_publisher(
                Clock, topics.CLOCK, QoSProfile(depth=10)
            )
        if twin.kind == 'stepper':
            self._loop: RealTimeLoop | LockstepLoop | StepperLoop = self._make_stepper(twin)
        else:
            self._loop = self._make_servo(twin)
        create_trigger_service(self, '~/reset', self._reset)
        self.diagnostics.task('plant', self._plant_status)
        self.diagnostics.task('tracker', self._tracker_status)
        # The plant's thread must get the interpreter within a tick.
        sys.setswitchinterval(SWITCH_INTERVAL)
        self._loop.start()
        self.get_logger().info(
            f'{self.value("clock")}, axes {" ".join(twin.axes)}, {self._loop.summary()}, '
            f'{self._tracker_summary()}'
        )

    def _make_servo(self, twin: TwinFile) -> RealTimeLoop | LockstepLoop:
        # Everything is compiled before a socket opens: the first client meets a ready machine.
        machine = ServoMachine(twin, self.value('seed'), self.value('noise'), self._model())
        drive = DriveSocket(len(machine.axes), self.value('drive_port'))
        self._tracker = self._open_tracker(twin)
        if self.value('clock') == 'realtime':
            return RealTimeLoop(machine, drive, self._tracker, self.value('watchdog'))
        return LockstepLoop(
            machine,
            drive,
            self._tracker,
            self._publish_clock,
            self.value('lockstep_watchdog'),
            self.value('clock_interval'),
        )

    def _model(self) -> str:
        """The MuJoCo model that moves the stage; empty for the kernel."""
        model = str(self.value('model'))
        if (self.value('engine') == 'mujoco') != bool(model):
            raise StageError('engine mujoco and the parameter model go together: set both or none')
        return model

    def _make_stepper(self, twin: TwinFile) -> StepperLoop:
        self._tracker = self._open_tracker(twin)
        return StepperLoop(
            twin,
            self._tracker,
            self.value('seed'),
            self.value('noise'),
            self.value('pty_link'),
            self._publish_clock if self._clock_publisher else None,
        )

    def _open_tracker(self, twin: TwinFile) -> TrackerServer | SaTextSender | None:
        protocol, port = self.value('tracker_protocol'), self.value('tracker_port')
        if protocol == 'none' or twin.tracker is None:
            return None
        if protocol != 'emscon':
            return SaTextSender(port, protocol.removeprefix('sa_'))
        instrument = TrackerInstrument(
            clock_offset_ns=round(self.value('tracker_clock_offset') * NANOSECONDS),
            packet_points=self.value('tracker_packet_points'),
        )
        return TrackerServer(instrument, port)

    def _tracker_summary(self) -> str:
        if isinstance(self._tracker, TrackerServer):
            return f'tracker TPI on 127.0.0.1:{self._tracker.port}'
        if self._tracker is not None:
            return f'tracker text to 127.0.0.1:{self.value("tracker_port")}'
        return 'no tracker'

    def _publish_clock(self, stamp: int) -> None:
        if self._clock_publisher is not None:
            self._simulated = stamp
            seconds, nanoseconds = split_stamp(stamp)
            self._clock_publisher.publish(Clock(clock=Time(sec=seconds, nanosec=nanoseconds)))

    def now(self) -> int:
        """Simulated time where this node makes it [ns]: its diagnostics belong to that time."""
        return self._simulated if self._clock_publisher is not None else super().now()

    def thread_priority(self) -> int:
        """In lockstep nothing is urgent."""
        return 0 if self.value('clock') == 'lockstep' else int(self.value('thread_priority'))

    def parameters_changed(self, changed: dict[str, Value]) -> str | None:
        """Switch a tracker fault; everything else is read when the node starts."""
        for name in changed:
            if name != 'tracker_fault':
                return f'{name} is read at the start only: start stage_twin with it'
        if self._tracker is None:
            return 'there is no emulated tracker: start stage_twin with tracker_protocol'
        self._tracker.set_fault(str(changed['tracker_fault']))
        return None

    def _reset(self) -> str:
        if not self._loop.reset():
            raise StageError('the plant does not answer')
        return 'reset'

    def _plant_status(self) -> tuple[bytes, str, dict[str, Any]]:
        level, message, values = self._loop.status()
        values['scheduling'] = self.scheduling
        return (OK, WARN, ERROR)[level], message, values

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


def main() -> int:
    """Run the node."""
    return run(StageTwin)


if __name__ == '__main__':
    sys.exit(main())
