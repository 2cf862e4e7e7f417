"""The base of every node: declared parameters, diagnostics, quality of service, start and stop."""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from stage_core import topics
from stage_core.clocks import join_stamp, split_stamp
from stage_core.errors import EXIT_BAD_INPUT, StageError
from stage_core.names import nearest
from stage_core.parameters import Parameter, Value, check
from stage_core.priority import to_real_time
from stage_core.ros import parameter_files
from stage_core.ros.descriptor_node import descriptor
from stage_core.ros.diagnostics_node import Diagnostics
from stage_core.ros.joint_state_wire import JointSample, JointStateLayout
from stage_core.ros.peers import PEERS, PeerWatch, speaker
from stage_core.ros.services_node import answering_late
from stage_core.signals import ending

#: Measurements are recorded for science: reliable, with a second of depth (interfaces.md).
STATE_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
SETPOINT_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
LATCHED_QOS = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)

OK, WARN, ERROR = b'\x00', b'\x01', b'\x02'

_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'

#: Parameters that ROS itself declares.
_ROS_PARAMETERS = ('use_sim_time', 'start_type_description_service')


class StageNode(Node):
    """A node whose parameters are declared from :class:`stage_core.parameters.Parameter`.

    Raises
    ------
    StageError
        For an unknown parameter or a value outside its range; the message names both.
    """

    def __init__(self, name: str, parameters: Sequence[Parameter], **options: Any) -> None:
        super().__init__(name, **options)
        parameter_files.refuse_misspelt(sys.argv, self.get_name())
        self._specifications = {p.name: p for p in parameters}
        self._refuse_unknown()
        for parameter in parameters:
            self._declare(parameter)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.diagnostics = Diagnostics(self, hardware_id=name)
        #: How the system schedules this process, for /diagnostics.
        self.scheduling = 'ordinary'
        self._watch_peers(PeerWatch(PEERS.get(name, ()), self._doubled))

    def create_service(self, *arguments: Any, **options: Any) -> Any:
        """A service as of :class:`rclpy.node.Node` that answers late callers, too."""
        made = super().create_service(*arguments, **options)
        return answering_late(made, self.get_logger().warning)

    def value(self, name: str) -> Any:
        """Current value of a declared parameter."""
        return self.get_parameter(name).value

    def now(self) -> int:
        """Time [ns] that this node's diagnostics carry: simulated time where time is simulated."""
        return int(self.get_clock().now().nanoseconds)

    def thread_priority(self) -> int:
        """SCHED_FIFO priority of this node's threads; 0 is ordinary, as all is in lockstep."""
        urgent = self.has_parameter('thread_priority') and not self.value('use_sim_time')
        return int(self.value('thread_priority')) if urgent else 0

    def shutdown(self) -> None:
        """Bring hardware to rest and close files; called once at the end, whatever ended it."""

    def node_spoke(self, node: str, data: bytes) -> None:
        """Hook: a node's DiagnosticArray as CDR bytes, this node's own among them."""

    def parameters_changed(self, changed: dict[str, Value]) -> str | None:
        """Hook for a change at run time: the reason to refuse it, or None to take it."""
        return None

    def _watch_peers(self, peers: PeerWatch) -> None:
        """Say on /diagnostics which nodes fell silent, and which of them speak twice."""

        def heard(data: bytes) -> None:
            spoke = speaker(data)
            if spoke is None:
                return
            if rival := peers.hear(*spoke):
                self.get_logger().warning(rival)
            self.node_spoke(spoke[0], data)

        def status() -> tuple[bytes, str, dict[str, Any]]:
            well, text, values = peers.status()
            return OK if well else WARN, text, values

        self.create_subscription(DiagnosticArray, topics.DIAGNOSTICS, heard, 10, raw=True)
        self.diagnostics.task('peers', status)

    def _doubled(self, node: str) -> bool:
        found = self.get_publishers_info_by_topic(topics.DIAGNOSTICS)
        return sum(publisher.node_name == node for publisher in found) > 1

    def _refuse_unknown(self) -> None:
        known = set(self._specifications) | set(_ROS_PARAMETERS)
        for name in self._parameter_overrides:
            if name not in known and not name.startswith('qos_overrides'):
                raise StageError(self._unknown(name))

    def _unknown(self, name: str) -> str:
        return f'{self.get_name()} has no parameter {name}: {nearest(name, self._specifications)}'

    def set_parameters_atomically(self, parameter_list: list[RosParameter]) -> SetParametersResult:
        """Set parameters, as the services do; for an unknown one the reason names the nearest."""
        for parameter in parameter_list:
            if not self.has_parameter(parameter.name):
                return SetParametersResult(successful=False, reason=self._unknown(parameter.name))
        return super().set_parameters_atomically(parameter_list)

    def _declare(self, parameter: Parameter) -> None:
        override = self._parameter_overrides.get(parameter.name)
        value: Any = parameter.default if override is None else override.value
        if override is not None:
            wrong = check(parameter, value)
            if wrong:
                raise StageError(f'parameter of {self.get_name()}: {wrong}')
            if isinstance(parameter.default, float):
                # ``-p feed:=1`` is an integer to ROS; the range says float.
                value = float(value)
                self._parameter_overrides[parameter.name] = RosParameter(
                    parameter.name, RosParameter.Type.DOUBLE, value
                )
        self.declare_parameter(parameter.name, value, descriptor(parameter))

    def _on_set_parameters(self, changes: list[RosParameter]) -> SetParametersResult:
        changed: dict[str, Value] = {}
        for change in changes:
            specification = self._specifications.get(change.name)
            if specification is None:
                continue
            wrong = check(specification, change.value)
            if wrong:
                return SetParametersResult(successful=False, reason=wrong)
            changed[change.name] = change.value
        reason = self.parameters_changed(changed) if changed else None
        return SetParametersResult(successful=reason is None, reason=reason or '')


def stamp_of(header: Any) -> int:
    """Stamp of a message header [ns]."""
    return join_stamp(header.stamp.sec, header.stamp.nanosec)


def set_stamp(header: Any, stamp: int) -> None:
    """Write a stamp [ns] into a message header."""
    header.stamp.sec, header.stamp.nanosec = split_stamp(stamp)


def joint_state(
    stamp: int,
    axes: Sequence[str],
    position: Sequence[float] | None = None,
    velocity: Sequence[float] | None = None,
    effort: Sequence[float] | None = None,
) -> JointState:
    """A JointState of the axes at `stamp` [ns]; what is not given stays empty."""
    message = JointState(name=list(axes))
    set_stamp(message.header, stamp)
    message.header.frame_id = topics.STAGE_FRAME
    if position is not None:
        message.position = [float(v) for v in position]
    if velocity is not None:
        message.velocity = [float(v) for v in velocity]
    if effort is not None:
        message.effort = [float(v) for v in effort]
    return message


class JointStateReader:
    """Reads the JointStates of a raw subscription; those of a known layout in one step."""

    #: Layouts kept: a stream has two or three, rubbish may have any number.
    _MOST = 16

    def __init__(self) -> None:
        self._layouts: dict[int, JointStateLayout | None] = {}

    def read(self, data: bytes) -> JointSample | None:
        """What a message says; None where its bytes are no JointState."""
        layout = self._layouts.get(len(data))
        if layout is not None and (sample := layout.decode(data)) is not None:
            return sample
        try:
            message = deserialize_message(data, JointState)
        except Exception:
            # Whatever a stranger put on the topic, it must not end the node.
            return None
        names, position, velocity = message.name, message.position, message.velocity
        if len(data) not in self._layouts and len(self._layouts) < self._MOST:
            counts = len(position), len(velocity), len(message.effort)
            known = JointStateLayout(message.header.frame_id, names, counts)
            self._layouts[len(data)] = known if known.decode(data) is not None else None
        return JointSample(stamp_of(message.header), names, position, velocity, message.effort)


def local_graph() -> None:
    """Keep the graph on this machine unless the user asked for more (before rclpy.init).

    With Fast DDS a profile says so instead of the variable, which would make the middleware send
    everything twice (see `fastdds_local.xml`); one that the user chose is left alone.
    """
    chosen = os.environ.setdefault(_RANGE, 'LOCALHOST')
    fast_dds = os.environ.get('RMW_IMPLEMENTATION', 'rmw_fastrtps').startswith('rmw_fastrtps')
    if chosen != 'LOCALHOST' or not fast_dds:
        return
    profile = str(Path(__file__).with_name('fastdds_local.xml'))
    if os.environ.setdefault('FASTRTPS_DEFAULT_PROFILES_FILE', profile) == profile:
        os.environ[_RANGE] = 'SYSTEM_DEFAULT'


def make_executor() -> Executor:
    """The executor of every node: a quarter of the CPU of the wait-set ones at 1 kHz."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def spin(executor: Executor, ended: threading.Event) -> None:
    """Spin until `ended` is set or rclpy shuts down.

    A loop of ``spin_once``: ``EventsExecutor.spin()`` of rclpy 7.1 fires no callback.
    """
    while not ended.is_set() and rclpy.ok():
        executor.spin_once(timeout_sec=0.1)


def first_time(node: Node, timeout: float = 30.0) -> int:
    """Simulated time [ns] as soon as it is known; for a node that nobody spins yet.

    Raises
    ------
    StageError
        If nobody publishes /clock.
    """
    executor = make_executor()
    executor.add_node(node)
    deadline = time.monotonic() + timeout
    try:
        while (now := node.get_clock().now().nanoseconds) == 0:
            if time.monotonic() > deadline:
                raise StageError(
                    f'nobody published {topics.CLOCK} for {timeout:.0f} s: start stage_twin with '
                    'clock:=lockstep, or set use_sim_time to false'
                )
            executor.spin_once(timeout_sec=0.1)
        return now
    finally:
        executor.remove_node(node)


def run(
    factory: Callable[[], StageNode | Sequence[StageNode]],
    arguments: Sequence[str] | None = None,
) -> int:
    """Run a node, or several in one process, until a signal ends it; the process' exit status.

    A :class:`StageError` while the nodes start is one line on stderr and exit status 2; so is what
    ROS itself refuses, as a node without its keys where SROS 2 is enforced. Several nodes are shut
    down in the order in which `factory` returns them.
    """
    local_graph()
    ended = threading.Event()
    try:
        parameter_files.check_files(sys.argv if arguments is None else arguments)
        rclpy.init(args=arguments, signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    except (StageError, rclpy_implementation.RCLError) as error:
        return _refused(error)
    for number in ending():
        signal.signal(number, lambda *_: ended.set())
    nodes: Sequence[StageNode] = ()
    executor: Executor | None = None
    try:
        try:
            made = factory()
            nodes = [made] if isinstance(made, StageNode) else made
        except (
            StageError,
            rclpy.exceptions.InvalidParameterTypeException,
            rclpy_implementation.RCLError,
        ) as error:
            return _refused(error)
        executor = make_executor()
        for node in nodes:
            executor.add_node(node)
        # What lives as long as the nodes is not looked through again: that takes many ticks.
        gc.collect()
        gc.freeze()
        scheduling = to_real_time(max(node.thread_priority() for node in nodes))
        for node in nodes:
            node.scheduling = scheduling
        spin(executor, ended)
        return 0
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    finally:
        for node in nodes:
            node.shutdown()
        if nodes:
            # The last messages (a stop, a fault) must leave before the participant does.
            time.sleep(0.05)
        for node in nodes:
            if executor is not None:
                executor.remove_node(node)
            node.destroy_node()
        if rclpy.ok():
            rclpy.shutdown()


def _refused(error: Exception) -> int:
    print(f'error: {" ".join(str(error).split())}', file=sys.stderr)
    return EXIT_BAD_INPUT
