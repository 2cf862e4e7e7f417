"""The nodes of a session and their parameters: the one list, for the session and for docs."""

from __future__ import annotations

import argparse
import random
import socket
import time
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from stage_bringup.processes import NodeCommand
from stage_core.errors import StageError

#: UDP ports of ROS 2 domain d begin at DDS_PORTS + d DDS_DOMAIN: ten for the domain, then two for
#: each participant (default ports of OMG DDSI-RTPS 2.5). Fifty participants are left room.
DDS_PORTS, DDS_DOMAIN, DDS_TAKES = 7400, 250, 110
#: What `control` holds in one process.
CONTROL = ('stage_driver', 'contour_ctrl')


@dataclass(frozen=True)
class Options:
    """What a session is asked for."""

    backend: str = 'servo'
    clock: str = 'lockstep'
    seed: int = 1
    out: Path = Path('bags/session')
    grid: int = 5
    heldout: int = 10
    iterations: int = 3
    method: str = 'structured'
    standard_tests: bool = False
    diagnose: bool = True
    reality: Path | None = None
    nominal: Path | None = None
    model: Path | None = None
    composed: bool = False


def machine_parser(prog: str, clock: str, **words: Any) -> argparse.ArgumentParser:
    """Command line with the options that say what machine runs and where its files go."""
    parser = argparse.ArgumentParser(prog=prog, **words)
    parser.add_argument(
        '--backend',
        choices=('servo', 'zaber'),
        help=f'drive that is emulated (default {Options.backend})',
    )
    parser.add_argument(
        '--clock',
        choices=('lockstep', 'realtime'),
        default=clock,
        help='lockstep: deterministic, as fast as the machine allows',
    )
    parser.add_argument('--out', type=Path, help='folder of all files (default bags/<time>)')
    parser.add_argument('--reality', type=Path, help='twin file of the machine that is emulated')
    parser.add_argument('--model', type=Path, help='MuJoCo model that moves as the machine')
    parser.add_argument('--nominal', type=Path, help='twin file of the nominal machine')
    return parser


def options_of(given: argparse.Namespace) -> Options:
    """The options that a command line of `machine_parser` gives."""
    known = {f.name for f in fields(Options)}
    told = {name: v for name, v in vars(given).items() if v is not None}
    options = Options(**{name: v for name, v in told.items() if name in known})
    out = given.out or Path('bags') / time.strftime('%Y%m%d-%H%M%S')
    return replace(options, out=out.resolve(), model=given.model and given.model.resolve())


def config_folder() -> Path:
    """Folder of the shipped parameter and twin files.

    Raises
    ------
    StageError
        If the package was moved away from the workspace that holds them.
    """
    for base in Path(__file__).resolve().parents:
        for candidate in (base / 'ros_ws' / 'config', base / 'share' / 'stage_bringup' / 'config'):
            if candidate.is_dir():
                return candidate
    raise StageError('ros_ws/config is not beside the packages: run from a whole checkout')


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """A port of the loopback interface that nobody uses now, below the ephemeral range.

    It is none that DDS gives to a node that starts later, in any domain.

    Raises
    ------
    StageError
        If none is found.
    """
    # Drawn at random: two sessions that start together must not pick the same one.
    draw = random.SystemRandom()
    for _ in range(200):
        port = draw.randrange(20000, 32000)
        if (port - DDS_PORTS) % DDS_DOMAIN < DDS_TAKES:
            continue
        with socket.socket(socket.AF_INET, kind) as probe:
            try:
                probe.bind(('127.0.0.1', port))
            except OSError:
                continue
            return port
    raise StageError('no free port between 20000 and 32000: end what holds them')


def zaber_port(options: Options) -> Path:
    """Where the emulated Zaber chain links its pseudo-terminal."""
    return options.out / 'zaber_port'


def nominal_twin(options: Options) -> Path:
    """Twin file of the nominal machine, with which driver, recorder and diagnosis work."""
    kind = 'stepper_' if options.backend == 'zaber' else ''
    return options.nominal or config_folder() / f'twin_{kind}nominal.yaml'


def reality_twin(options: Options) -> Path:
    """Twin file of the machine that is emulated."""
    kind = 'stepper_' if options.backend == 'zaber' else ''
    if options.model and not options.reality:
        # The model is the machine: what the file says of another one does not count.
        return nominal_twin(options)
    return options.reality or config_folder() / f'twin_{kind}reality.yaml'


def commands(options: Options) -> list[NodeCommand]:
    """Every node of the session, the plant first."""
    lockstep, nominal = options.clock == 'lockstep', nominal_twin(options)
    drive_port, tracker_port = free_port(socket.SOCK_DGRAM), free_port()
    contour = 'contour_ctrl_zaber' if options.backend == 'zaber' else 'contour_ctrl'
    out = options.out
    listeners = [
        _driver(options, drive_port),
        _node(
            'tracker_bridge',
            host='127.0.0.1',
            port=tracker_port,
            source_clock='ros' if lockstep else 'own',
        ),
        _node(
            'session_recorder', module='session_bags.recorder_node', directory=out, twin=nominal
        ),
        _node('calibrator', method=options.method, model_folder=out / 'models'),
        _node(
            'contour_ctrl',
            contour,
            iterations=options.iterations,
            scheme='ccc+rilc',
            session_folder=out / 'learned',
        ),
        # The world in lockstep waits for its slowest node, and live mode reads every message: such
        # a session is diagnosed from its bag.
        _node('gap_diagnosis', twin=nominal, out=out / 'diagnosis', live=not lockstep),
    ]
    if lockstep:
        listeners = [
            replace(c, parameters={**c.parameters, 'use_sim_time': True}) for c in listeners
        ]
    found = [_plant(options, drive_port, tracker_port), *listeners]
    return composed(found) if options.composed else found


def _node(name: str, file: str = '', module: str = '', **parameters: object) -> NodeCommand:
    """A node with its shipped parameter file, which has its name where no other is given."""
    path = config_folder() / f'{file or name}.yaml'
    return NodeCommand(name, module or f'{name}.node', parameters, (path,))


def _plant(options: Options, drive_port: int, tracker_port: int) -> NodeCommand:
    mujoco: dict[str, Any] = {'engine': 'mujoco', 'model': options.model} if options.model else {}
    return _node(
        'stage_twin',
        twin=reality_twin(options),
        clock=options.clock,
        # No node of a session needs the time between set-points and encoders, which carry their
        # own; every message wakes seven processes.
        clock_interval=10 if options.clock == 'lockstep' else 1,
        seed=options.seed,
        drive_port=drive_port,
        tracker_port=tracker_port,
        pty_link=zaber_port(options),
        **mujoco,
    )


def _driver(options: Options, drive_port: int) -> NodeCommand:
    backend = 'zaber' if options.backend == 'zaber' else 'servo'
    wire: dict[str, Any] = (
        {'port': zaber_port(options)} if backend == 'zaber' else {'drive_port': drive_port}
    )
    return _node(
        'stage_driver',
        f'stage_driver_{backend}',
        backend=backend,
        twin=nominal_twin(options),
        # The position loop forgets a move's lag within 0.35 s; the rest of the dwell is measured.
        settle_time=0.6,
        **wire,
    )


def composed(found: list[NodeCommand]) -> list[NodeCommand]:
    """The same nodes with driver and contour controller in one process, see `control`."""
    both = [command for command in found if command.name in CONTROL]
    together = NodeCommand(
        'control',
        'stage_bringup.control',
        {f'{c.name}:{name}': value for c in both for name, value in c.parameters.items()},
        tuple(path for c in both for path in c.parameter_files),
    )
    place = found.index(both[0])
    others = [command for command in found if command not in both]
    return [*others[:place], together, *others[place:]]
