"""A short-lived node that looks at the graph."""

from __future__ import annotations

import argparse
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from stage_core.errors import StageError
from stage_core.ros.node import local_graph

#: Discovery has settled when nothing new was seen for this long [s] ...
_QUIET = 0.5
#: ... and where nobody was seen yet for this long: the first one answers within 0.3 s.
_ALONE = 1.5
#: A graph that changes all the time is taken as it is after this time [s].
_LONGEST = 3.0
_PERIOD = 0.05
#: Longest wait for something that is named [s].
_NAMED = 6.0


@contextmanager
def node(name: str = '') -> Iterator[Any]:
    """A hidden node, spun in a thread of its own."""
    import rclpy
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

    local_graph()
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    looker = rclpy.create_node(
        name or f'_ros2cli_{os.getpid()}',
        start_parameter_services=False,
        enable_rosout=False,
    )
    executor = SingleThreadedExecutor()
    executor.add_node(looker)

    def spin() -> None:
        with suppress(ExternalShutdownException):
            executor.spin()

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    try:
        yield looker
    finally:
        executor.shutdown(timeout_sec=1.0)
        thread.join(timeout=2.0)
        looker.destroy_node()
        rclpy.try_shutdown()


def settle(looker: Any, spin_time: float | None = None) -> None:
    """Wait until discovery has settled, or for exactly `spin_time` [s]."""
    if spin_time is not None:
        time.sleep(spin_time)
        return
    last: Any = None
    changed = time.monotonic()

    def quiet() -> bool:
        nonlocal last, changed
        seen = (
            sorted(looker.get_node_names_and_namespaces()),
            sorted(looker.get_topic_names_and_types()),
            sorted(looker.get_service_names_and_types()),
        )
        if seen != last:
            last, changed = seen, time.monotonic()
        alone = len(seen[0]) < 2
        return time.monotonic() - changed >= (_ALONE if alone else _QUIET)

    with suppress(StageError):
        wait_until(quiet, 'the graph changes all the time', _LONGEST)


def wait_until(found: Callable[[], Any], absent: str, timeout: float = _NAMED) -> Any:
    """The first true value of ``found()``: the one loop that looks at the graph.

    Raises
    ------
    StageError
        With the text `absent`, after `timeout` [s].
    """
    deadline = time.monotonic() + timeout
    while True:
        value = found()
        if value:
            return value
        if time.monotonic() > deadline:
            raise StageError(absent)
        time.sleep(_PERIOD)


def wait_for_type(names_and_types: Callable[[], Any], name: str, absent: str) -> str:
    """Type of a topic or service as soon as it is on the graph; else StageError as above."""
    return str(wait_until(lambda: dict(names_and_types()).get(name), absent)[0])


def add_list_options(verb: argparse.ArgumentParser, what: str) -> None:
    """Declare the options of ``topic list`` and ``service list``."""
    verb.add_argument('-t', '--show-types', action='store_true')
    verb.add_argument('-c', f'--count-{what}', action='store_true', dest='count')
    verb.add_argument(f'--include-hidden-{what}', action='store_true', dest='include_hidden')
    verb.add_argument('--spin-time', type=float)


def print_names(arguments: argparse.Namespace, names_and_types: Callable[[Any], Any]) -> None:
    """Print what a settled graph holds, as `add_list_options` has asked."""
    with node() as looker:
        settle(looker, arguments.spin_time)
        found = sorted(names_and_types(looker))
    shown = [(n, types) for n, types in found if arguments.include_hidden or not hidden(n)]
    if arguments.count:
        print(len(shown))
        return
    for name, types in shown:
        print(f'{name} [{", ".join(types)}]' if arguments.show_types else name)


def hidden(name: str) -> bool:
    """Whether a part of a name begins with an underscore."""
    return any(part.startswith('_') for part in name.split('/'))


def full_name(name: str) -> str:
    """A name with its leading slash."""
    return name if name.startswith('/') else '/' + name


def node_names(looker: Any, include_hidden: bool = False) -> list[str]:
    """Full names of the nodes on the graph, sorted."""
    names = [
        f'{namespace.rstrip("/")}/{name}'
        for name, namespace in looker.get_node_names_and_namespaces()
    ]
    return sorted(name for name in names if include_hidden or not hidden(name))


def split_name(name: str) -> tuple[str, str]:
    """Node name and namespace of a full name."""
    namespace, _, base = full_name(name).rpartition('/')
    return base, namespace or '/'


def require_node(looker: Any, name: str) -> str:
    """Full name of a node that is on the graph.

    Raises
    ------
    StageError
        If it does not appear.
    """
    wanted = full_name(name)
    wait_until(lambda: wanted in node_names(looker, True), 'Node not found')
    return wanted


def call(looker: Any, service_type: Any, name: str, request: Any, timeout: float = 10.0) -> Any:
    """Call a service of the graph.

    Raises
    ------
    StageError
        If the service does not appear or does not answer.
    """
    client = looker.create_client(service_type, name)
    if not client.wait_for_service(timeout_sec=timeout):
        raise StageError(f'service {name} is not available: is its node running?')
    return answer(client.call_async(request), name)


def answer(future: Any, name: str, timeout: float = 3600.0) -> Any:
    """Response of a call that was sent."""
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    if not done.wait(timeout):
        raise StageError(f'service {name} did not answer')
    return future.result()


def listening_qos(looker: Any, topic: str) -> Any:
    """Quality of service that matches every publisher of a topic."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    publishers = looker.get_publishers_info_by_topic(topic)
    profiles = [publisher.qos_profile for publisher in publishers]
    reliable = profiles and all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
    latched = profiles and all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
    return QoSProfile(
        depth=1000,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def parameter_message(name: str, value: Any) -> Any:
    """A parameter as the services of a node take it.

    Raises
    ------
    StageError
        If no parameter can hold such a value.
    """
    from rclpy.parameter import Parameter

    try:
        return Parameter(name, value=value).to_parameter_msg()
    except (TypeError, ValueError, AssertionError) as error:
        raise StageError(f'{name} cannot be {value!r}: name a number, a word or a list') from error
