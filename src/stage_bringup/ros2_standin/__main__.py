"""``ros2``: the verbs that a user of this workspace needs, where ros2cli is not installed."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence

from ros2_standin.executables import find
from ros2_standin.install import real_ros2
from stage_core.errors import EXIT_INTERRUPTED, StageError, command_line

_LAUNCH = (
    'ros2 launch needs the real ROS 2 (launch is not on PyPI): `ros2 run stage_bringup up` '
    'brings up the same nodes'
)


def make_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog='ros2', description='ros2 is an extensible command-line tool for ROS 2 (stand-in).'
    )
    commands = parser.add_subparsers(dest='command', required=True, metavar='command')
    groups = {}
    for group in ('bag', 'param', 'service', 'topic'):
        command = commands.add_parser(group, help=f'Various {group} related sub-commands')
        groups[group] = command.add_subparsers(dest='verb', required=True, metavar='verb')
    _add_bag_verbs(groups['bag'])
    _add_graph_verbs(groups)
    run = commands.add_parser('run', help='Run a package specific executable')
    run.add_argument('package_name')
    run.add_argument('executable_name')
    run.add_argument('argv', nargs=argparse.REMAINDER)
    run.set_defaults(run=lambda a: become(a.package_name, a.executable_name, a.argv))
    launch = commands.add_parser('launch', help='Run a launch file')
    launch.add_argument('argv', nargs=argparse.REMAINDER)
    launch.set_defaults(run=refuse_launch)
    return parser


def _add_bag_verbs(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
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


def _add_graph_verbs(
    groups: dict[str, argparse._SubParsersAction[argparse.ArgumentParser]],
) -> None:
    """Those of `graph_node`, with their words in order: a last one of messages may be left out."""
    for group, name, function, words, text in (
        ('param', 'list', 'list_parameters', 'node_name', 'Output a list of parameters'),
        ('param', 'set', 'set_parameter', 'node_name parameter_name value', 'Set parameter'),
        ('service', 'call', 'call_service', 'service_name service_type values', 'Call a service'),
        ('topic', 'echo', 'echo', 'topic', 'Output messages from a topic'),
        ('topic', 'hz', 'hz', 'topic', 'Print the average publishing rate to screen'),
        ('topic', 'pub', 'publish', 'topic type values', 'Publish a message to a topic'),
    ):
        verb = groups[group].add_parser(name, help=text)
        for word in words.split():
            verb.add_argument(word, nargs='?' if word == 'values' else None, default='{}')
        if name in ('echo', 'pub'):
            verb.add_argument('-1', '--once', action='store_true', help='One message, then exit')
        if name == 'pub':
            verb.add_argument('-r', '--rate', type=float, default=1.0)
        verb.set_defaults(run=_on_graph(function))


def _on_graph(function: str) -> Callable[[argparse.Namespace], None]:
    """A verb of `graph_node`, which loads ROS."""

    def run(arguments: argparse.Namespace) -> None:
        from ros2_standin import graph_node

        getattr(graph_node, function)(arguments)

    return run


def become(package: str, name: str, words: list[str]) -> None:
    """Become an executable."""
    line, environment = find(package, name, sys.executable)
    sys.stdout.flush()
    os.execve(line[0], [*line, *words], environment)


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
    become('session_bags', 'session_player', words)


def refuse_launch(_: argparse.Namespace) -> None:
    """Say what to use in place of launch files."""
    raise StageError(_LAUNCH)


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb; a real ``ros2`` on PATH takes over."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    real = real_ros2()
    if real is not None:
        os.execv(str(real), [str(real), *words])
    parsed = make_parser().parse_args(words)
    try:
        return parsed.run(parsed) or 0
    except (KeyboardInterrupt, BrokenPipeError):
        return EXIT_INTERRUPTED


if __name__ == '__main__':
    sys.exit(main())
