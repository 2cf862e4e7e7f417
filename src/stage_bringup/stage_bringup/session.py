"""A whole session on the embedded twin: ``ros2 run stage_bringup session``."""

from __future__ import annotations

import json
import os
import shlex
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from stage_bringup.graph import CONTROL, Options, commands, machine_parser, options_of
from stage_bringup.interrupts import Interrupts
from stage_bringup.processes import NodeCommand, Processes
from stage_bringup.provenance import provenance
from stage_core.errors import EXIT_INTERRUPTED, StageError, command_line
from stage_core.whole_file import write_whole

#: Nodes of this machine find each other well within this time [s].
LOOKOUT = 1.5

EPILOG = (
    'Exit status: 0 when every step passed, 1 when one failed, 2 for an option that cannot be '
    'met. Nothing is left running.'
)


def parse(arguments: Sequence[str] | None) -> Options:
    """Options of the command line.

    Raises
    ------
    StageError
        For a combination that cannot run.
    """
    parser = machine_parser('session', Options.clock, description=__doc__, epilog=EPILOG)
    for name, kind, text in (
        ('seed', int, 'seed of noise and held-out points'),
        ('grid', int, 'points per side of the grid'),
        ('heldout', int, 'held-out points'),
        ('iterations', int, 'runs of the circle'),
        ('method', str, 'calibration method'),
    ):
        parser.add_argument(f'--{name}', type=kind, default=getattr(Options, name), help=text)
    parser.add_argument(
        '--standard-tests', action='store_true', help='test both axes by ISO 230-2 too'
    )
    parser.add_argument(
        '--no-diagnosis', dest='diagnose', action='store_false', help='skip the gap diagnosis'
    )
    parser.add_argument(
        '--composed', action='store_true', help='driver and contour controller in one process'
    )
    options = options_of(parser.parse_args(arguments))
    if options.grid < 3 or options.heldout < 3 or options.iterations < 1:
        raise StageError('a session needs --grid >= 3, --heldout >= 3 and --iterations >= 1')
    if options.out.exists() and (not options.out.is_dir() or any(options.out.iterdir())):
        raise StageError(f'{options.out} is not empty, or no folder: name another one with --out')
    return options


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the session; see ``--help``."""
    options = parse(arguments)
    begin, origin = time.monotonic(), provenance()

    def session(processes: Processes) -> None:
        from stage_bringup.steps import run_steps

        result = run_steps(options, processes)
        result.data.update(origin)
        print(result.text)
        found = {**result.data, 'lines': result.lines}
        write_whole(options.out / 'session.json', json.dumps(found, indent=1))
        from stage_bringup.report import write_report

        print(f'report: {write_report(options, result)}')

    status = run_graph(options, commands(options), session)
    print(f'session: {options.out} ({time.monotonic() - begin:.0f} s)')
    return status


def run_graph(
    options: Options, nodes: Sequence[NodeCommand], work: Callable[[Processes], None]
) -> int:
    """Start the nodes, do the work and end them, whatever happens; the exit status.

    Raises
    ------
    StageError
        If such a graph runs already.
    """
    interrupts = Interrupts()
    try:
        status = _run(options, nodes, work, interrupts)
    except BaseException:
        # An import that an interrupt broke off may raise an error of its own instead.
        if not interrupts.came:
            raise
    return EXIT_INTERRUPTED if interrupts.came else status


def _run(
    options: Options,
    nodes: Sequence[NodeCommand],
    work: Callable[[Processes], None],
    interrupts: Interrupts,
) -> int:
    from stage_bringup.kernels import compile_missing

    names = [*CONTROL, *(node.name for node in nodes)]
    refuse_second_graph(names)
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise StageError(f'{options.out} is no folder: name another with --out') from error
    processes = Processes(options.out / 'log', interrupts.check)
    status = 0
    try:
        if compile_missing():
            # Another graph may have started meanwhile.
            refuse_second_graph(names)
        for node in nodes:
            processes.start(node)
        work(processes)
    except StageError as error:
        print(f'error: {" ".join(str(error).split())}', file=sys.stderr)
        status = 1
    finally:
        interrupts.ending = True
        if interrupts.came:
            print('interrupted: the stage is brought to rest', file=sys.stderr)
        killed = processes.end()
        if killed:
            print(f'error: {", ".join(killed)} did not end and was killed', file=sys.stderr)
    if status:
        # Only now: the recorder closes its bag when it ends.
        print('\n'.join(left_behind(options.out)), file=sys.stderr)
    return status or int(bool(killed))


def left_behind(folder: Path) -> list[str]:
    """What a session that failed left in its folder, and the command that shows the newest bag."""
    from session_bags.archive import find_bags

    try:
        bags = sorted(find_bags(folder), key=lambda bag: bag.stat().st_mtime)
    except StageError:
        bags = []
    saved = [*bags, *sorted((folder / 'models').glob('*.json'))]
    words = [f'logs of the nodes in {folder / "log"}']
    if saved:
        names = ', '.join(str(path.relative_to(folder)) for path in saved)
        words.insert(0, f'{names} in {folder}')
    lines = [f'saved: {"; ".join(words)}']
    if bags:
        command = ['ros2', 'run', 'stage_reports', 'report', '--bag', str(bags[-1])]
        command += ['--out', str(folder / 'report')]
        lines.append(f'report of the newest bag: {shlex.join(command)}')
    return lines


def refuse_second_graph(names: Sequence[str]) -> None:
    """Look whether a node of these names is on the domain already.

    Raises
    ------
    StageError
        If one is; two graphs would drive each other's stage.
    """
    from stage_core.ros.client_node import GraphClient

    with GraphClient('session') as client:
        deadline = time.monotonic() + LOOKOUT
        while time.monotonic() < deadline:
            found = sorted(set(names) & set(client.node.get_node_names()))
            if found:
                domain = os.environ.get('ROS_DOMAIN_ID', '0')
                raise StageError(
                    f'{", ".join(found)} runs on ROS_DOMAIN_ID {domain} already: end it, or start '
                    'the session with another ROS_DOMAIN_ID'
                )
            time.sleep(0.05)


if __name__ == '__main__':
    sys.exit(main())
