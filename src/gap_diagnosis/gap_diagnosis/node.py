"""Node `gap_diagnosis`: diagnoses a bag on request and watches the gap of a running session."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import PointStamped, TransformStamped
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from gap_diagnosis.experiment_node import run_experiment
from stage_core import topics
from stage_core.errors import StageError
from stage_core.frames import alignment_in
from stage_core.parameters import Parameter
from stage_core.priority import to_background
from stage_core.ros.batch_node import Batches
from stage_core.ros.node import (
    LATCHED_QOS,
    OK,
    STATE_QOS,
    WARN,
    JointStateReader,
    StageNode,
    run,
    stamp_of,
)
from stage_core.ros.services_node import create_deferred_service
from stage_core.twin_file import TwinFile

if TYPE_CHECKING:
    from gap_diagnosis.live import LiveMonitor

PARAMETERS = (
    Parameter('bag', '', 'session bag that ~/diagnose reads'),
    Parameter('holdout', '', 'held-out session bag; empty: windows of the bag itself'),
    Parameter('twin', '', 'twin file of the nominal machine; live mode follows it'),
    Parameter('out', 'gap_report', 'directory that gets the report', read_only=True),
    Parameter('seed', 0, 'of bootstrap and permutations', minimum=0),
    Parameter('allow_motion', False, 'whether ~/experiment may move the stage'),
    Parameter(
        'travel', '', 'what an experiment may use, as x:-0.05:0.05 y:0:0.1; empty: as the session'
    ),
    Parameter('live', True, 'follow the running session and keep its gap on /diagnostics'),
    Parameter('window', 6.0, 'length of a window of live mode', 's', minimum=2.0, maximum=600.0),
    Parameter('learn', 5, 'windows that make the band of live mode', minimum=2, maximum=1000),
    Parameter('band', 5.0, 'half width of the band', 'standard deviations', minimum=1.0),
)


class GapDiagnosisNode(StageNode):
    """Thin shell around `gap_diagnosis.service` and `gap_diagnosis.live`."""

    def __init__(self) -> None:
        super().__init__('gap_diagnosis', PARAMETERS)
        self.verdict = 'no diagnosis yet'
        # What can be refused is refused before a thread runs.
        self.monitor = self._live_monitor()
        self._process: subprocess.Popen[str] | None = None
        self._lock = threading.Lock()
        self._job: Future[str] | None = None
        create_deferred_service(
            self, Trigger, '~/diagnose', lambda _: self._begin(self._on_diagnose)
        )
        create_deferred_service(
            self, Trigger, '~/experiment', lambda _: self._begin(self._on_experiment)
        )
        self.diagnostics.task('diagnosis', lambda: (OK, self.verdict, {}))
        if self.monitor is not None:
            self._start_live()

    def _begin(self, action: Callable[[], str]) -> Future[str]:
        """Start what takes seconds to minutes; what waited for its end would move later.

        It waits in a thread, and computes in a process, of its own: live mode misses nothing.
        """
        if self._job is not None and not self._job.done():
            raise StageError('a diagnosis or an experiment is under way: wait for its end')
        job = self._job = Future()

        def work() -> None:
            try:
                job.set_result(action())
            except Exception as error:
                job.set_exception(error)

        threading.Thread(target=work, daemon=True).start()
        return job

    def _live_monitor(self) -> LiveMonitor | None:
        """The monitor of live mode; None where it is off or has no loop to follow."""
        if not self.value('live') or not self.value('twin'):
            return None
        twin = TwinFile.load(self.value('twin'))
        if twin.kind == 'stepper':
            self.get_logger().info('live mode is off: a stepper twin has no servo loop to follow')
            return None
        if twin.kind != 'servo':
            raise StageError(
                f'live mode needs a twin of kind servo, not {twin.kind}: set live to false'
            )
        # Numba's kernels, which nothing else here needs.
        from gap_diagnosis.live import LiveMonitor

        return LiveMonitor(twin, self.value('window'), self.value('learn'), self.value('band'))

    def _start_live(self) -> None:
        self._batches = Batches(self)
        for topic, fields in (
            (topics.REFERENCE, ('position', 'velocity')),
            (topics.COMMAND, ('velocity', 'effort')),
            (topics.JOINT_STATES, ('position',)),
        ):
            self._batches.create_subscription(JointState, topic, self._collector(topic, fields))
        self.create_subscription(PointStamped, topics.TRACKER_POINT, self._on_point, STATE_QOS)
        self.create_subscription(
            TransformStamped, topics.ALIGNMENT, self._on_alignment, LATCHED_QOS
        )
        self.create_timer(1.0, self._on_judge)
        self.diagnostics.task('gap', self._gap)

    def _collector(self, topic: str, fields: tuple[str, ...]) -> Any:
        monitor = self.monitor
        assert monitor is not None
        reader = JointStateReader()

        def take(data: bytes, _: dict[str, int]) -> None:
            message = reader.read(data)
            if message is None:
                return
            values = tuple(v for name in fields for v in getattr(message, name))
            if len(values) == len(fields) * len(message.names):
                monitor.add(topic, message.stamp, tuple(message.names), values)

        return take

    def _on_point(self, message: PointStamped) -> None:
        assert self.monitor is not None
        p = message.point
        self.monitor.add_point(stamp_of(message.header), p.x, p.y, p.z)

    def _on_alignment(self, message: TransformStamped) -> None:
        assert self.monitor is not None
        try:
            self.monitor.alignment = alignment_in(message)
        except StageError as error:
            self.get_logger().warning(str(error))

    def _on_judge(self) -> None:
        assert self.monitor is not None
        try:
            self.monitor.judge()
        except StageError as error:
            self.monitor.clear()
            self.get_logger().warning(str(error))

    def _gap(self) -> tuple[bytes, str, dict[str, Any]]:
        assert self.monitor is not None
        bands = self.monitor.bands
        if not bands:
            return OK, 'waiting for a running session', {}
        values = {n: f'{1e6 * b.latest:.3f} µm' for n, b in bands.items()}
        left = [n for n, b in bands.items() if b.left]
        if left:
            low, high = bands[left[0]].limits
            return (
                WARN,
                f'the gap of {", ".join(left)} left its band ({1e6 * low:.2f} to '
                f'{1e6 * high:.2f} µm): something on the machine changed, diagnose a session',
                values,
            )
        ready = all(b.ready for b in bands.values())
        return OK, 'within its band' if ready else 'learning the band', values

    def _on_diagnose(self) -> str:
        """Run the diagnosis on the parameters; its verdict line."""
        if not self.value('bag') or not self.value('twin'):
            raise StageError('set the parameters bag and twin first')
        return self._diagnose([self.value('bag')])

    def _on_experiment(self) -> str:
        """Run the experiment of the last report; what it decided."""
        lockstep = bool(self.get_parameter('use_sim_time').value)
        try:
            return run_experiment(self.value, lockstep, self._diagnose)
        except (OSError, ValueError) as error:
            raise StageError(str(error)) from error

    def _diagnose(self, bags: list[str]) -> str:
        """The last line of a diagnosis of some bags in a process of its own.

        Raises
        ------
        StageError
            With that line, if the diagnosis failed.
        """
        command = [sys.executable, '-m', 'gap_diagnosis', 'diagnose']
        for bag in bags:
            command += ['--bag', bag]
        if self.value('holdout'):
            command += ['--holdout', self.value('holdout')]
        command += ['--twin', self.value('twin'), '--out', self.value('out')]
        command += ['--seed', str(self.value('seed'))]
        for axis in self.value('travel').split():
            command += ['--travel', axis]
        with self._lock:
            self._process = subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
            )
            to_background(self._process.pid)
        assert self._process.stderr is not None and self._process.stdout is not None
        said = []
        for line in self._process.stderr:
            said.append(line)
            # What it does now is the diagnosis's sentence on /diagnostics.
            self.verdict = line.strip().removeprefix('[gap_diagnosis] ')
        output = self._process.stdout.read()
        success = self._process.wait() == 0
        lines = output.strip().splitlines() if success else said
        self.verdict = lines[-1].strip() if lines else 'the diagnosis ended without a word'
        if not success:
            raise StageError(self.verdict)
        return self.verdict

    def shutdown(self) -> None:
        """End a running diagnosis."""
        with self._lock:
            if self._process is not None and self._process.poll() is None:
                self._process.terminate()


def main() -> int:
    """Entry point of ``ros2 run gap_diagnosis gap_diagnosis``."""
    return run(GapDiagnosisNode)


if __name__ == '__main__':
    sys.exit(main())
