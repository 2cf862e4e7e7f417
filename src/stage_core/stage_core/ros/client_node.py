"""A client of the graph for scripts and tests: calls services, waits for messages."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool, Trigger

from stage_core.errors import StageError
from stage_core.patience import Patience
from stage_core.ros.node import STATE_QOS, local_graph, make_executor, spin

#: A server that this client has found may not have found this client's ear for the answer yet:
#: the first call waits so long [s], or its answer could be lost.
ACQUAINTANCE = 0.7

Client = TypeVar('Client', bound='GraphClient')


class GraphClient:
    """A node spun in a thread of its own, with calls that block the caller and time out."""

    def __init__(self, name: str = 'graph_client', use_sim_time: bool = False) -> None:
        local_graph()
        self._owns_context = not rclpy.ok()
        if self._owns_context:
            rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
        overrides = [RosParameter('use_sim_time', value=use_sim_time)]
        self.node = Node(name, parameter_overrides=overrides)
        self._executor = make_executor()
        self._executor.add_node(self.node)
        self._ended = threading.Event()
        self._thread = threading.Thread(
            target=spin, args=(self._executor, self._ended), name=name, daemon=True
        )
        self._thread.start()
        self._latest: dict[str, Any] = {}
        self._arrival: dict[str, float] = {}
        self._changed = threading.Condition()
        self._arrived = 0
        self._clients: dict[str, Any] = {}
        self._acquainted: dict[str, float] = {}

    def close(self) -> None:
        """Stop the thread and leave the graph."""
        self._ended.set()
        self._thread.join(timeout=5.0)
        self._executor.remove_node(self.node)
        # An executor that is not shut down keeps the node in the graph for as long as the process.
        self._executor.shutdown()
        self.node.destroy_node()
        if self._owns_context and rclpy.ok():
            rclpy.shutdown()

    def __enter__(self: Client) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def watch(
        self,
        message_type: type,
        topic: str,
        qos: QoSProfile | int = STATE_QOS,
        callback: Callable[[Any], None] | None = None,
    ) -> None:
        """Subscribe to a topic; the newest message is kept, `callback` sees each."""

        def arrived(message: Any) -> None:
            self._came(topic, message)
            if callback is not None:
                callback(message)

        self.node.create_subscription(message_type, topic, arrived, qos)

    def _came(self, topic: str, message: Any) -> None:
        with self._changed:
            self._latest[topic] = message
            self._arrival[topic] = time.monotonic()
            self._arrived += 1
            self._changed.notify_all()

    def latest(self, topic: str) -> Any | None:
        """The newest message of a watched topic, or None."""
        return self._latest.get(topic)

    def progress(self) -> object:
        """What goes on while a wait is not in vain: each change of it begins the wait anew."""
        return None

    def wait_for(
        self, condition: Callable[[], bool], timeout: float, what: str, poll: float = 0.05
    ) -> None:
        """Wait until `condition()` holds; it may call services.

        Raises
        ------
        StageError
            After `timeout` [s] of wall time without `progress`; the message says what was awaited.
        """
        if not self.comes(condition, Patience(timeout, self.progress), poll):
            raise StageError(f'waited {timeout:.0f} s in vain for {what}')

    def comes(self, condition: Callable[[], bool], patience: Patience, poll: float = 0.05) -> bool:
        """Wait until `condition()` holds or the patience ends; whether it holds."""
        seen = self._arrived
        # Asked without the lock: the answer of a service that the condition calls comes through
        # the same thread as the messages, which the lock would hold up.
        while not condition():
            left = patience.left()
            if left <= 0.0:
                return False
            with self._changed:
                if self._arrived == seen:
                    self._changed.wait(min(left, poll))
                seen = self._arrived
        return True

    def wait_until_quiet(self, topic: str, quiet: float, timeout: float) -> None:
        """Wait until a watched topic has been silent for `quiet` [s] of wall time.

        In lockstep virtual time stands still when nobody drives the stage; then everything that
        was measured has arrived.
        """
        begin = time.monotonic()
        self.wait_for(
            lambda: min(self.silence(topic), time.monotonic() - begin) >= quiet,
            timeout,
            f'silence on {topic}',
        )

    def silence(self, topic: str) -> float:
        """Wall time since the newest message of a watched topic [s]; infinite before the first."""
        return time.monotonic() - self._arrival.get(topic, -math.inf)

    def call(self, service_type: type, name: str, request: Any, timeout: float) -> Any:
        """Call a service and return its response.

        Raises
        ------
        StageError
            If the service is absent, or does not answer within `timeout` [s] of wall time without
            `progress`.
        """
        client = self._reach(service_type, name, min(timeout, 30.0))
        time.sleep(max(0.0, self._acquainted[name] + ACQUAINTANCE - time.monotonic()))
        future = client.call_async(request)
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        patience = Patience(timeout, self.progress)
        while not done.wait(min(max(patience.left(), 0.0), 1.0)):
            if patience.left() <= 0.0:
                raise StageError(f'service {name} did not answer within {timeout:.0f} s')
        return future.result()

    def _reach(
        self,
        service_type: type,
        name: str,
        timeout: float,
        alive: Callable[[], None] = lambda: None,
    ) -> Any:
        """The client of a service that is there."""
        # One client per service: a fresh one may miss the answer while discovery still runs.
        if name not in self._clients:
            self._clients[name] = self.node.create_client(service_type, name)
        deadline = time.monotonic() + timeout
        while not self._clients[name].wait_for_service(timeout_sec=min(timeout, 0.5)):
            alive()
            if time.monotonic() > deadline:
                raise StageError(f'service {name} is absent: is its node running?')
        self._acquainted.setdefault(name, time.monotonic())
        return self._clients[name]

    def wait_for_service(
        self, name: str, timeout: float, alive: Callable[[], None] = lambda: None
    ) -> None:
        """Wait until a Trigger service is there; `alive` may raise meanwhile."""
        self._reach(Trigger, name, timeout, alive)

    def trigger(self, name: str, timeout: float = 30.0) -> str:
        """Call a Trigger service; its message.

        Raises
        ------
        StageError
            If it answers without success, with its reason.
        """
        return self._do(Trigger, name, Trigger.Request(), timeout)

    def set_bool(self, name: str, value: bool, timeout: float = 30.0) -> str:
        """Call a SetBool service; its message (see :meth:`trigger`)."""
        return self._do(SetBool, name, SetBool.Request(data=value), timeout)

    def _do(self, service_type: type, name: str, request: Any, timeout: float) -> str:
        response = self.call(service_type, name, request, timeout)
        if not response.success:
            raise StageError(f'{name} failed: {response.message}')
        return str(response.message)

    def set_parameters(self, node: str, timeout: float = 30.0, **values: Any) -> None:
        """Set parameters of another node (``__`` in a name stands for a dot).

        Raises
        ------
        StageError
            If the node refuses a value, with its reason.
        """
        request = SetParameters.Request(
            parameters=[
                RosParameter(name.replace('__', '.'), value=value).to_parameter_msg()
                for name, value in values.items()
            ]
        )
        response = self.call(SetParameters, f'{node}/set_parameters', request, timeout)
        for result in response.results:
            if not result.successful:
                raise StageError(f'{node} refused a parameter: {result.reason}')
