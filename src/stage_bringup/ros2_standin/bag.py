"""``ros2 bag info|play`` through session_bags."""

from __future__ import annotations

import argparse
import json
import os
import sys

from ros2_standin.executables import command, find


def add_verbs(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs."""
    verbs = parser.add_subparsers(dest='verb', required=True, metavar='verb')
    verb = verbs.add_parser('info', help='Print information about a bag to the screen')
    verb.add_argument('bag_path')
    verb.set_defaults(run=info)
    verb = verbs.add_parser('play', help='Play back ROS data from a bag')
    verb.add_argument('bag_path')
    verb.add_argument('-r', '--rate', type=float, default=1.0)
    verb.add_argument('-l', '--loop', action='store_true')
    verb.add_argument('--topics', nargs='+', default=[])
    verb.add_argument('--clock', action='store_true', help='Publish /clock')
    verb.set_defaults(run=play)


def info(arguments: argparse.Namespace) -> None:
    """Print what a bag holds."""
    from session_bags.info import describe

    print('\n' + describe(arguments.bag_path), end='')


def play(arguments: argparse.Namespace) -> None:
    """Become a player."""
    from session_bags.bag import open_bag

    parameters = {
        'bag': arguments.bag_path,
        'rate': arguments.rate,
        'loop': arguments.loop,
        'clock': arguments.clock,
        'topics': arguments.topics or sorted(open_bag(arguments.bag_path).topic_types()),
    }
    words = ['--ros-args']
    for key, value in parameters.items():
        words += ['-p', f'{key}:={json.dumps(value)}']
    line = command(find('session_bags', 'session_player'), words, sys.executable)
    sys.stdout.flush()
    os.execv(line[0], line)
