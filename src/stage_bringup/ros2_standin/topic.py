"""``ros2 topic list|info|echo|hz|pub``."""

from __future__ import annotations

import argparse
import math
import threading
import time
from collections import deque
from typing import Any

from ros2_standin.graph_node import (
    add_list_options,
    full_name,
    listening_qos,
    node,
    print_names,
    settle,
    wait_for_type,
    wait_until,
)
from ros2_standin.messages import fill, from_plain_field, interface, to_plain, to_yaml
from stage_core.errors import StageError


def add_verbs(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs."""
    verbs = parser.add_subparsers(dest='verb', required=True, metavar='verb')
    verb = verbs.add_parser('list', help='Output a list of available topics')
    add_list_options(verb, 'topics')
    verb.set_defaults(run=list_topics)
    verb = verbs.add_parser('info', help='Print information about a topic')
    verb.add_argument('topic')
    verb.add_argument('-v', '--verbose', action='store_true')
    verb.set_defaults(run=info)
    verb = verbs.add_parser('type', help="Print a topic's type")
    verb.add_argument('topic')
    verb.set_defaults(run=type_of)
    verb = verbs.add_parser('echo', help='Output messages from a topic')
    verb.add_argument('topic')
    verb.add_argument('type', nargs='?')
    verb.add_argument('--once', action='store_true', help='Print the first message, then exit')
    verb.add_argument('--field', help='Print a selected field of a message')
    verb.add_argument('--csv', action='store_true')
    verb.add_argument('--timeout', type=float, help='Give up after this many seconds')
    verb.set_defaults(run=echo)
    verb = verbs.add_parser('hz', help='Print the average publishing rate to screen')
    verb.add_argument('topic')
    verb.add_argument('-w', '--window', type=int, default=10000)
    verb.set_defaults(run=hz)
    verb = verbs.add_parser('pub', help='Publish a message to a topic')
    verb.add_argument('topic')
    verb.add_argument('type')
    verb.add_argument('values', nargs='?', default='{}')
    verb.add_argument('-1', '--once', action='store_true')
    verb.add_argument('-r', '--rate', type=float, default=1.0)
    verb.add_argument('-t', '--times', type=int, default=0)
    verb.add_argument('-w', '--wait-matching-subscriptions', type=int)
    verb.set_defaults(run=publish)


def list_topics(arguments: argparse.Namespace) -> None:
    """Print the topics' names."""
    print_names(arguments, lambda looker: looker.get_topic_names_and_types())


def _type_name(looker: Any, topic: str) -> str:
    return wait_for_type(
        looker.get_topic_names_and_types,
        topic,
        f'Could not determine the type for the passed topic: {topic} is not published',
    )


def info(arguments: argparse.Namespace) -> None:
    """Print a topic's type and numbers of publishers and subscriptions."""
    topic = full_name(arguments.topic)
    with node() as looker:
        try:
            type_name = _type_name(looker, topic)
        except StageError:
            raise StageError(f"Unknown topic '{topic}'") from None
        settle(looker)
        publishers = looker.get_publishers_info_by_topic(topic)
        subscriptions = looker.get_subscriptions_info_by_topic(topic)
    print(f'Type: {type_name}')
    for word, ends in (('Publisher', publishers), ('Subscription', subscriptions)):
        print(f'{chr(10) if arguments.verbose else ""}{word} count: {len(ends)}')
        for end in ends if arguments.verbose else ():
            print(f'\n{end}')


def type_of(arguments: argparse.Namespace) -> None:
    """Print a topic's type."""
    with node() as looker:
        print(_type_name(looker, full_name(arguments.topic)))


def echo(arguments: argparse.Namespace) -> None:
    """Print messages as they come."""
    topic = full_name(arguments.topic)
    ended = threading.Event()
    failure: list[StageError] = []

    def arrived(message: Any) -> None:
        if ended.is_set():
            return
        try:
            _print(message, arguments)
        except StageError as error:
            failure.append(error)
            ended.set()
        except BrokenPipeError:
            ended.set()
        if arguments.once:
            ended.set()

    with node() as looker:
        type_name = arguments.type or _type_name(looker, topic)
        if not arguments.type:
            wait_until(
                lambda: looker.get_publishers_info_by_topic(topic), f'no publisher of {topic}'
            )
        looker.create_subscription(
            interface(type_name, 'msg'), topic, arrived, listening_qos(looker, topic)
        )
        came = ended.wait(arguments.timeout)
    if failure:
        raise failure[0]
    if not came:
        raise StageError(f'no message on {topic} within {arguments.timeout} s')


def _print(message: Any, arguments: argparse.Namespace) -> None:
    part = from_plain_field(message, arguments.field) if arguments.field else message
    if arguments.csv:
        print(','.join(_flat(to_plain(part))), flush=True)
        return
    if hasattr(part, 'get_fields_and_field_types') or isinstance(to_plain(part), list):
        text = to_yaml(part)
    else:
        text = f'{part}\n'
    print(f'{text}---', flush=True)


def _flat(value: Any) -> list[str]:
    if isinstance(value, dict):
        return [word for item in value.values() for word in _flat(item)]
    if isinstance(value, list):
        return [word for item in value for word in _flat(item)]
    return [str(value)]


def hz(arguments: argparse.Namespace) -> None:
    """Print the rate of arrival once a second."""
    topic = full_name(arguments.topic)
    times: deque[float] = deque(maxlen=max(arguments.window, 2) + 1)
    with node() as looker:
        type_name = _type_name(looker, topic)
        looker.create_subscription(
            interface(type_name, 'msg'),
            topic,
            lambda _: times.append(time.monotonic()),
            listening_qos(looker, topic),
            raw=True,
        )
        last = 0
        while True:
            time.sleep(1.0)
            stamps = list(times)
            if len(stamps) < 2 or stamps[-1] == last:
                continue
            last = stamps[-1]  # type: ignore[assignment]
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
    """Publish one message again and again."""
    topic = full_name(arguments.topic)
    message = fill(interface(arguments.type, 'msg')(), arguments.values)
    times = 1 if arguments.once else arguments.times
    wanted = arguments.wait_matching_subscriptions
    wanted = (1 if times else 0) if wanted is None else wanted
    with node() as looker:
        publisher = looker.create_publisher(type(message), topic, 10)
        if wanted:
            print(f'Waiting for at least {wanted} matching subscription(s)...')
            wait_until(
                lambda: publisher.get_subscription_count() >= wanted,
                f'nobody subscribes to {topic}',
                30.0,
            )
        print('publisher: beginning loop')
        number = 0
        while not times or number < times:
            number += 1
            print(f'publishing #{number}: {message!r}\n', flush=True)
            publisher.publish(message)
            time.sleep(0.3 if number == times else 1.0 / arguments.rate)
