"""``ros2 topic list|echo|hz|pub``."""

from __future__ import annotations

import argparse
import math
import threading
import time
from collections import deque
from typing import Any

from ros2_standin.graph_node import Looker, full_name, print_names
from ros2_standin.messages import fill, interface, to_yaml


def add_verbs(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs."""
    verbs = parser.add_subparsers(dest='verb', required=True, metavar='verb')
    verb = verbs.add_parser('list', help='Output a list of available topics')
    verb.add_argument('-t', '--show-types', action='store_true')
    verb.set_defaults(run=list_topics)
    verb = verbs.add_parser('echo', help='Output messages from a topic')
    verb.add_argument('topic')
    verb.add_argument('--once', action='store_true', help='Print the first message, then exit')
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
    verb.set_defaults(run=publish)


def list_topics(arguments: argparse.Namespace) -> None:
    """Print the topics' names."""
    print_names(lambda node: node.get_topic_names_and_types(), arguments.show_types)


def echo(arguments: argparse.Namespace) -> None:
    """Print messages as they come."""
    topic = full_name(arguments.topic)
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

    with Looker() as looker:
        kind = interface(looker.topic_type(topic), 'msg')
        looker.watch(kind, topic, looker.listening_qos(topic), arrived)
        ended.wait()


def hz(arguments: argparse.Namespace) -> None:
    """Print the rate of arrival after each second in which a message came."""
    topic = full_name(arguments.topic)
    times: deque[float] = deque(maxlen=max(arguments.window, 2) + 1)
    with Looker() as looker:
        kind = interface(looker.topic_type(topic), 'msg')
        qos = looker.listening_qos(topic)
        looker.watch(kind, topic, qos, lambda _: times.append(time.monotonic()))
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
    with Looker() as looker:
        publisher = looker.node.create_publisher(type(message), topic, 10)
        if arguments.once:
            print('Waiting for at least 1 matching subscription(s)...')
            listeners = publisher.get_subscription_count
            looker.require(listeners, f'nobody subscribes to {topic}', 30.0)
        print('publisher: beginning loop')
        number = 0
        while number == 0 or not arguments.once:
            number += 1
            print(f'publishing #{number}: {message!r}\n', flush=True)
            publisher.publish(message)
            time.sleep(0.3 if arguments.once else 1.0 / arguments.rate)
