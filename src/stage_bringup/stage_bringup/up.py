"""Every node in one terminal, ended together: ``ros2 run stage_bringup up``.

Without options the emulated machine runs in real time. ``--port`` names a real Zaber stage,
``--drive`` the drive of a real servo stage; neither has a tracker unless ``--tracker`` names one.
Ctrl-C ends all.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from stage_bringup.graph import Options, commands, machine_parser, options_of
from stage_bringup.processes import NodeCommand, Processes
from stage_bringup.session import run_graph
from stage_core.drive_link import DEFAULT_PORT as DRIVE_PORT
from stage_core.errors import EXIT_INTERRUPTED, StageError, command_line

#: A tracker without a port in its address listens here (emScon TPI).
TPI_PORT = 700
#: Seconds between two looks at the logs.
PERIOD = 0.2


def parse(arguments: Sequence[str] | None) -> tuple[Options, list[NodeCommand]]:
    """Options and the nodes to start.

    Raises
    ------
    StageError
        For an address that names no host or port, or an option of the emulated machine beside a
        real one.
    """
    parser = machine_parser(
        'up',
        'realtime',
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    stage = parser.add_mutually_exclusive_group()
    stage.add_argument('--port', help='port of a real Zaber stage, as /dev/ttyUSB0')
    stage.add_argument('--drive', help='drive of a real servo stage, HOST or HOST:PORT')
    parser.add_argument('--tracker', help='address of a real tracker, HOST or HOST:PORT')
    parser.add_argument('--page-port', type=int, default=8766, help='port of the live page')
    given = parser.parse_args(arguments)
    real = bool(given.port or given.drive)
    if (real or given.tracker) and given.clock == 'lockstep':
        raise StageError('a real machine runs in real time: leave out --clock lockstep')
    emulated = [f'--{o}' for o in ('backend', 'reality', 'model') if real and getattr(given, o)]
    if emulated:
        raise StageError(f'{emulated[0]} is for an emulated stage: leave it out beside a real one')
    options = options_of(given)
    if real:
        options = replace(options, backend='zaber' if given.port else 'servo')
    nodes = [_changed(node, given) for node in commands(options)]
    if real:  # no emulated tracker beside a real stage
        absent = ('stage_twin',) if given.tracker else ('stage_twin', 'tracker_bridge')
        nodes = [node for node in nodes if node.name not in absent]
    # The Foxglove socket is one port beside the page, as by default.
    live = {
        'page_port': given.page_port,
        'port': given.page_port - 1,
        'use_sim_time': given.clock == 'lockstep',
    }
    nodes.append(NodeCommand('live_view', 'stage_bringup.live_view_node', live))
    return options, nodes


def _changed(node: NodeCommand, given: argparse.Namespace) -> NodeCommand:
    """The node with the addresses of real hardware in place of the emulated one's."""
    real: dict[str, Any] = {}
    if node.name == 'stage_driver' and given.port:
        real = {'port': given.port}
    if node.name == 'stage_driver' and given.drive:
        host, port = _address('--drive', given.drive, DRIVE_PORT)
        real = {'drive_host': host, 'drive_port': port}
    if node.name == 'tracker_bridge' and given.tracker:
        host, port = _address('--tracker', given.tracker, TPI_PORT)
        real = {'host': host, 'port': port}
    return replace(node, parameters={**node.parameters, **real})


def _address(option: str, text: str, usual: int) -> tuple[str, int]:
    host, _, number = text.partition(':')
    if not host or (number and not number.isdigit()):
        raise StageError(f'{text} names no host and port: give {option} HOST or HOST:PORT')
    return host, int(number or usual)


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Start the nodes and show what they say until Ctrl-C or the end of one."""
    options, nodes = parse(arguments)

    def follow(processes: Processes) -> None:
        print(f'{len(nodes)} nodes start; logs in {processes.log_folder}; Ctrl-C ends all')
        _follow(processes, [node.name for node in nodes])

    status = run_graph(options, nodes, follow)
    return 0 if status == EXIT_INTERRUPTED else status


def _follow(processes: Processes, names: list[str]) -> None:
    """Print the nodes' lines as they come; raises when a node ends."""
    read = dict.fromkeys(names, 0)
    while True:
        for name in names:
            text = (processes.log_folder / f'{name}.log').read_bytes()
            whole = text.rfind(b'\n') + 1
            if whole > read[name]:
                print(text[read[name] : whole].decode(errors='replace'), end='', flush=True)
                read[name] = whole
        processes.check()
        time.sleep(PERIOD)


if __name__ == '__main__':
    sys.exit(main())
