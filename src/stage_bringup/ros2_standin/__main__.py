"""``ros2``: the verbs that a user of this workspace needs, where ros2cli is not installed."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from ros2_standin import bag, param_node, services, topic
from ros2_standin.executables import command, environment, find, packages
from ros2_standin.install import real_ros2
from stage_core.errors import StageError, command_line

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
    bag.add_verbs(commands.add_parser('bag', help='Various rosbag related sub-commands'))
    services.add_node_verbs(commands.add_parser('node', help='Various node related sub-commands'))
    services.add_service_verbs(commands.add_parser('service', help='Various service sub-commands'))
    param_node.add_verbs(commands.add_parser('param', help='Various param related sub-commands'))
    topic.add_verbs(commands.add_parser('topic', help='Various topic related sub-commands'))
    run = commands.add_parser('run', help='Run a package specific executable')
    run.add_argument('package_name')
    run.add_argument('executable_name')
    run.add_argument('argv', nargs=argparse.REMAINDER)
    run.set_defaults(run=run_executable)
    package = commands.add_parser('pkg', help='Various package related sub-commands')
    verbs = package.add_subparsers(dest='verb', required=True, metavar='verb')
    verbs.add_parser('list', help='Output a list of packages').set_defaults(run=list_packages)
    verb = verbs.add_parser('executables', help='Output a list of package executables')
    verb.add_argument('package_name', nargs='?')
    verb.set_defaults(run=list_executables)
    launch = commands.add_parser('launch', help='Run a launch file')
    launch.add_argument('argv', nargs=argparse.REMAINDER)
    launch.set_defaults(run=refuse_launch)
    return parser


def run_executable(arguments: argparse.Namespace) -> None:
    """Become the executable."""
    executable = find(arguments.package_name, arguments.executable_name)
    line = command(executable, arguments.argv, sys.executable)
    sys.stdout.flush()
    os.execve(line[0], line, environment(executable))


def list_packages(_: argparse.Namespace) -> None:
    """Print the packages' names."""
    for name in sorted(packages()):
        print(name)


def list_executables(arguments: argparse.Namespace) -> None:
    """Print packages with their executables."""
    known = packages()
    if arguments.package_name and arguments.package_name not in known:
        raise StageError(f"Unknown package name '{arguments.package_name}'")
    for name in sorted(known):
        if arguments.package_name in (None, name):
            for executable in known[name]:
                print(f'{name} {executable.name}')


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
        return 130


if __name__ == '__main__':
    sys.exit(main())
