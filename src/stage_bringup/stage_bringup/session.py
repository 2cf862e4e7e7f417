"""A whole session on the embedded twin: ``ros2 run stage_bringup session``."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from stage_bringup.graph import CONTROL, Options, commands, config_folder
from stage_bringup.keep_awake import KeepAwake
from stage_bringup.processes import Processes
from stage_bringup.progress import Progress
from stage_bringup.provenance import provenance
from stage_core.errors import StageError, command_line
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
    parser = argparse.ArgumentParser(prog='session', description=__doc__, epilog=EPILOG)
    parser.add_argument('--backend', choices=('servo', 'zaber'), default='servo')
    parser.add_argument(
        '--clock',
        choices=('lockstep', 'realtime'),
        default='lockstep',
        help='lockstep: deterministic, as fast as the machine allows (default)',
    )
    parser.add_argument('--seed', type=int, default=1, help='seed of noise and held-out points')
    parser.add_argument('--out', type=Path, help='folder of the session (default bags/<time>)')
    parser.add_argument(
        '--grid', type=int, default=Options.grid, help='points per side of the grid'
    )
    parser.add_argument('--heldout', type=int, default=Options.heldout, help='held-out points')
    parser.add_argument('--iterations', type=int, default=3, help='runs of the circle')
    parser.add_argument('--method', default='structured', help='calibration method')
    parser.add_argument(
        '--standard-tests', action='store_true', help='test both axes by ISO 230-2 too'
    )
    parser.add_argument('--no-diagnosis', action='store_true', help='skip the gap diagnosis')
    parser.add_argument('--reality', type=Path, help='twin file of the machine that is emulated')
    parser.add_argument('--model', type=Path, help='MuJoCo model that moves as the machine')
    parser.add_argument('--nominal', type=Path, help='twin file of the nominal machine')
    parser.add_argument(
        '--composed', action='store_true', help='driver and contour controller in one process'
    )
    given = parser.parse_args(arguments)
    if given.grid < 3 or given.heldout < 3 or given.iterations < 1:
        raise StageError('a session needs --grid >= 3, --heldout >= 3 and --iterations >= 1')
    out = given.out or Path('bags') / time.strftime('%Y%m%d-%H%M%S')
    if out.exists() and any(out.iterdir()):
        raise StageError(f'{out} is not empty: name another folder with --out')
    return Options(
        backend=given.backend,
        clock=given.clock,
        seed=given.seed,
        out=out.resolve(),
        grid=given.grid,
        heldout=given.heldout,
        iterations=given.iterations,
        method=given.method,
        standard_tests=given.standard_tests,
        diagnose=not given.no_diagnosis,
        reality=given.reality,
        nominal=given.nominal,
        model=given.model and given.model.resolve(),
        # The world in lockstep waits for its slowest node, and live mode reads every topic of
        # every tick: the session is diagnosed from its bag.
        live=given.clock != 'lockstep',
        composed=given.composed,
    )


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the session; see ``--help``."""
    options = parse(arguments)
    config_folder()
    nodes = commands(options)
    names = [*CONTROL, *(node.name for node in nodes)]
    refuse_second_graph(names)
    options.out.mkdir(parents=True, exist_ok=True)
    take_interrupts()
    begin, origin = time.monotonic(), provenance()
    processes = Processes(options.out / 'log')
    status = 0
    awake = ExitStack()
    try:
        if options.clock == 'realtime':
            awake.enter_context(KeepAwake())
        if _compile():
            # Another graph may have started meanwhile.
            refuse_second_graph(names)
        for node in nodes:
            processes.start(node)
        from stage_bringup.steps import run_steps

        result = run_steps(options, processes)
        result.data.update(origin)
        print(result.text)
        found = {**result.data, 'lines': result.lines}
        write_whole(options.out / 'session.json', json.dumps(found, indent=1))
        from stage_bringup.report import write_report

        print(f'report: {write_report(options, result)}')
    except StageError as error:
        print(f'error: {" ".join(str(error).split())}', file=sys.stderr)
        status = 1
    except KeyboardInterrupt:
        print('interrupted: the stage is brought to rest', file=sys.stderr)
        status = 130
    finally:
        killed = processes.end()
        awake.close()
    if killed:
        print(f'error: {", ".join(killed)} did not end and was killed', file=sys.stderr)
        status = status or 1
    print(f'session: {options.out} ({time.monotonic() - begin:.0f} s)')
    return status


def _compile() -> bool:
    """Compile what the nodes would, where a person can see it; False where nothing was left to."""
    from stage_bringup import kernels

    if kernels.marker().exists():
        return False
    print(f'[ 0] {kernels.SENTENCE}', flush=True)
    with Progress() as progress:
        kernels.compile_all(progress.show)
    return True


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


class Interrupted(KeyboardInterrupt):
    """Ctrl-C or SIGTERM.

    `python -m` ends by SIGINT, whatever the exit status, if a plain KeyboardInterrupt once came up
    inside an `exec`, as that of each dataclass is while modules are imported.
    """


def take_interrupts() -> None:
    """Ctrl-C and SIGTERM take the same way out: the graph is ended before this process is."""

    def interrupt(*_: object) -> None:
        raise Interrupted

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupt)


if __name__ == '__main__':
    sys.exit(main())
