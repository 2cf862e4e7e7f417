"""``ros2 topic echo|hz|pub``, ``service call`` and ``param list|set``, by a short-lived node."""

from __future__ import annotations

import argparse
import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from rcl_interfaces.srv import ListParameters
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from ros2_standin.messages import fill, interface, to_yaml
from stage_core.errors import StageError
from stage_core.ros.client_node import GraphClient
from stage_core.untrusted import yaml_value

#: Longest wait for a publisher [s]; found within one where the machine is quiet.
_APPEARS = 10.0
#: Longest wait for a listener [s].
_LISTENS = 30.0
#: Longest wait for the answer of a service [s]: a training takes minutes.
_LONGEST_CALL = 3600.0
#: Gaps over which `hz` takes its mean.
_WINDOW = 10000


def full_name(name: str) -> str:
    """A name with its leading slash."""
    return name if name.startswith('/') else '/' + name


def _client() -> GraphClient:
    """A client whose name, after a low line, is hidden from lists."""
    return GraphClient(f'_ros2cli_{os.getpid()}')


def _listen(client: GraphClient, topic: str, callback: Callable[[Any], None]) -> None:
    """Subscribe to a topic as soon as somebody publishes it, with what matches every publisher."""
    node = client.node
    try:
        client.wait_for(lambda: bool(node.get_publishers_info_by_topic(topic)), _APPEARS, topic)
    except StageError:
        raise StageError(
            f'Could not determine the type for the passed topic: {topic} is not published'
        ) from None
    publishers = node.get_publishers_info_by_topic(topic)
    profiles = [p.qos_profile for p in publishers]
    reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
    latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
    qos = QoSProfile(
        depth=1000,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
    client.watch(interface(publishers[0].topic_type, 'msg'), topic, qos, callback)


def echo(arguments: argparse.Namespace) -> None:
    """Print messages as they come."""
    ended = threading.Event()

    def arrived(message: Any) -> None:
        if ended.is_set():
            return
        try:
            print(f'{to_yaml(message)}---', flush=True)
        except BrokenPipeError:
            ended.set()
        if arguments.once:
            ended.set()

    with _client() as client:
        _listen(client, full_name(arguments.topic), arrived)
        ended.wait()


def hz(arguments: argparse.Namespace) -> None:
    """Print the rate of arrival after each second in which a message came."""
    times: deque[float] = deque(maxlen=_WINDOW + 1)
    with _client() as client:
        _listen(client, full_name(arguments.topic), lambda _: times.append(time.monotonic()))
        while True:
            seen = len(times) and times[-1]
            time.sleep(1.0)
            stamps = list(times)
            if len(stamps) > 1 and stamps[-1] != seen:
                print(rate_report(stamps), flush=True)


def rate_report(times: list[float]) -> str:
    """Two lines of ``ros2 topic hz`` from times of arrival [s]."""
    gaps = [late - early for early, late in zip(times, times[1:], strict=False)]
    mean = sum(gaps) / len(gaps)
    deviation = math.sqrt(sum((gap - mean) ** 2 for gap in gaps) / len(gaps))
    return (
        f'average rate: {1.0 / mean:.3f}\n\tmin: {min(gaps):.3f}s max: {max(gaps):.3f}s '
        f'std dev: {deviation:.5f}s window: {len(gaps)}'
    )


def publish(arguments: argparse.Namespace) -> None:
    """Publish one message once, as soon as somebody listens, or again and again."""
    topic = full_name(arguments.topic)
    message = fill(interface(arguments.type, 'msg')(), arguments.values)
    with _client() as client:
        publisher = client.node.create_publisher(type(message), topic, 10)
        if arguments.once:
            print('Waiting for at least 1 matching subscription(s)...')
            listeners = publisher.get_subscription_count
            client.wait_for(lambda: listeners() > 0, _LISTENS, f'a subscriber of {topic}')
        print('publisher: beginning loop')
        number = 0
        while number == 0 or not arguments.once:
            number += 1
            print(f'publishing #{number}: {message!r}\n', flush=True)
            publisher.publish(message)
            time.sleep(0.3 if arguments.once else 1.0 / arguments.rate)


def call_service(arguments: argparse.Namespace) -> None:
    """Call a service and print request and response."""
    kind = interface(arguments.service_type, 'srv')
    request = fill(kind.Request(), arguments.values)
    with _client() as client:
        print(f'requester: making request: {request!r}\n', flush=True)
        response = client.call(kind, full_name(arguments.service_name), request, _LONGEST_CALL)
    print(f'response:\n{response!r}\n')


def list_parameters(arguments: argparse.Namespace) -> None:
    """Print the parameters of a node."""
    name = f'{full_name(arguments.node_name)}/list_parameters'
    with _client() as client:
        response = client.call(ListParameters, name, ListParameters.Request(), _APPEARS)
    for parameter in sorted(response.result.names):
        print(f'  {parameter}')


def set_parameter(arguments: argparse.Namespace) -> None:
    """Set one parameter; its text is read as YAML where that gives a value or a list."""
    name, value = arguments.parameter_name, arguments.value
    try:
        read = yaml_value(value, 'the value', 'it is taken as text')
        value = value if isinstance(read, (dict, type(None))) else read
    except StageError:
        pass
    with _client() as client:
        try:
            client.set_parameters(full_name(arguments.node_name), **{name: value})
        except (TypeError, ValueError, AssertionError) as error:
            raise StageError(
                f'{name} cannot be {value!r}: name a number, a word or a list'
            ) from error
    print('Set parameter successful')
