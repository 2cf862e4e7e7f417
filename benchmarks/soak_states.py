"""Hypothesis calls every service, sets every parameter and publishes on topics, in any order.

    nice -n 15 .venv/bin/python benchmarks/soak_states.py --minutes 10

Exit 1 where a node ends, the stage leaves its travel or a process grows (see
`tests/reliability/exploration.py`); the steps that led there are printed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from hypothesis import HealthCheck, Phase, settings
from hypothesis.stateful import run_state_machine_as_test

from stage_bringup.graph import Options
from tests.domains import reserve_domain
from tests.reliability.exploration import World, machine
from tests.reliability.rig import running

STEPS = settings(
    max_examples=5,
    stateful_step_count=40,
    deadline=None,
    database=None,
    phases=(Phase.generate,),
    suppress_health_check=tuple(HealthCheck),
)


def main() -> int:
    """Explore until the time is over."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--minutes', type=float, default=10.0)
    given = parser.parse_args()
    reserve_domain()
    with (
        tempfile.TemporaryDirectory() as folder,
        running(Options(out=Path(folder) / 'out')) as (nodes, watch),
    ):
        world = World(nodes, watch)
        before = dict(world.sizes)
        world.end = time.monotonic() + 60.0 * given.minutes
        while not world.over():
            run_state_machine_as_test(machine(world), settings=STEPS)
        if world.broken:
            print(world.broken, file=sys.stderr)
            return 1
        world.abort()
        world.settled()
        grown = ', '.join(
            f'{name} {(world.memory(name) - size) / 2**20:+.0f}' for name, size in before.items()
        )
    print(
        f'{world.calls} calls of {len(world.services)} services and {len(world.parameters)} '
        f'parameters, {world.answers} answered in time; no node ended; memory [MiB]: {grown}'
    )
    return 0


if __name__ == '__main__':
    sys.exit(main())
