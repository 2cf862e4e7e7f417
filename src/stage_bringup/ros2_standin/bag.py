"""``ros2 bag record|info|play`` through the nodes of session_bags."""

from __future__ import annotations

import argparse
import json
import os
import sys
from datetime import datetime
from pathlib import Path

from ros2_standin.executables import command, find
from stage_core.errors import StageError


def add_verbs(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs."""
    verbs = parser.add_subparsers(dest='verb', required=True, metavar='verb')
    verb = verbs.add_parser('info', help='Print information about a bag to the screen')
    verb.add_argument('bag_path')
    verb.add_argument('-s', '--storage', help='Ignored: the bag says what it is')
    verb.set_defaults(run=info)
    verb = verbs.add_parser('record', help='Record ROS data to a bag')
    verb.add_argument('topics', nargs='*')
    verb.add_argument('-a', '--all', action='store_true', help='Record all topics')
    verb.add_argument('-o', '--output', help='Destination of the bag')
    verb.add_argument('-s', '--storage', default='mcap', choices=('mcap',))
    verb.add_argument('--use-sim-time', action='store_true')
    verb.set_defaults(run=record)
    verb = verbs.add_parser('play', help='Play back ROS data from a bag')
    verb.add_argument('bag_path')
    verb.add_argument('-r', '--rate', type=float, default=1.0)
    verb.add_argument('-l', '--loop', action='store_true')
    verb.add_argument('-d', '--delay', type=float, default=1.0)
    verb.add_argument('--start-offset', type=float, default=0.0)
    verb.add_argument('--topics', nargs='+', default=[])
    verb.add_argument('--clock', nargs='?', const=100.0, type=float, help='Publish /clock')
    verb.set_defaults(run=play)


def info(arguments: argparse.Namespace) -> None:
    """Print what a bag holds."""
    from session_bags.info import describe

    print('\n' + describe(arguments.bag_path), end='')


def record(arguments: argparse.Namespace) -> None:
    """Become a recorder that starts at once and ends with SIGINT."""
    if not arguments.topics and not arguments.all:
        raise StageError('Need to specify at least one topic, or --all')
    default = datetime.now().strftime('rosbag2_%Y_%m_%d-%H_%M_%S')
    output = Path(arguments.output or default)
    if output.exists():
        raise StageError(f"Output folder '{output}' already exists.")
    topics = ['*'] if arguments.all else arguments.topics
    _become(
        'session_recorder',
        directory=str(output.parent),
        name=output.name,
        topics=topics,
        autostart=True,
        use_sim_time=arguments.use_sim_time,
    )


def play(arguments: argparse.Namespace) -> None:
    """Become a player."""
    from session_bags.bag import open_bag

    topics = arguments.topics or sorted(open_bag(arguments.bag_path).topic_types())
    _become(
        'session_player',
        bag=arguments.bag_path,
        rate=arguments.rate,
        loop=arguments.loop,
        delay=arguments.delay,
        start=arguments.start_offset,
        clock=arguments.clock is not None,
        topics=topics,
    )


def _become(executable: str, /, **parameters: object) -> None:
    """Replace this process by a node of session_bags."""
    words = ['--ros-args']
    for key, value in parameters.items():
        words += ['-p', f'{key}:={json.dumps(value)}']
    line = command(find('session_bags', executable), words, sys.executable)
    sys.stdout.flush()
    os.execv(line[0], line)
