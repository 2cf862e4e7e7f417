"""The experiment that decides, run by the whole graph in lockstep.

    python -m benchmarks.experiment.graph --seeds 401 403 --out build/experiment_graph

Each case is one of `machine.py` with an effect of the drive. Twin, driver, contour controller,
recorder and diagnosis are processes of their own. The contour controller runs the motion of the
first session; `~/diagnose` reads the bag; `~/experiment` moves the stage and diagnoses both bags.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.experiment.machine import PERIOD, draw, nominal, poor_motion
from benchmarks.experiment.run import TRAVEL
from benchmarks.rows import cases, commit, table
from gap_diagnosis.experiment_node import record_experiment
from gap_diagnosis.report.experiment import FILE
from gap_diagnosis.report.experiment import table as motion
from stage_bringup.graph import Options, commands
from stage_bringup.processes import NodeCommand, Processes
from stage_core.ros.client_node import GraphClient
from stage_twin.effects import effect_of

NODES = ('stage_twin', 'stage_driver', 'session_recorder', 'contour_ctrl')
PATIENCE = 600.0  # of a service's answer [s]


def run_case(seed: int, out: Path) -> dict[str, Any]:
    """Verdicts before and after the experiment."""
    case = draw(seed)
    if effect_of(case.effect).link != 'servo':
        raise SystemExit(f'seed {seed} is {case.effect}, which the drive does not have')
    out.mkdir(parents=True, exist_ok=True)
    reality, file, report = out / 'reality.yaml', out / 'nominal.yaml', out / 'report'
    nominal().with_effects({case.effect: case.values}).save(reality)
    nominal().save(file)
    report.mkdir(exist_ok=True)
    position = poor_motion(case)
    (report / FILE).write_text(motion(position, PERIOD, ('x', 'y')), encoding='utf-8')
    travel = ' '.join(f'{axis}:{low}:{high}' for axis, (low, high) in TRAVEL.items())
    asker = NodeCommand(
        'gap_diagnosis',
        'gap_diagnosis.node',
        {'use_sim_time': True, 'live': False, 'twin': file, 'out': report, 'travel': travel},
    )
    options = Options(out=out / 'session', reality=reality, nominal=file)
    graph = Processes(out / 'log')
    try:
        for command in [c for c in commands(options) if c.name in NODES] + [asker]:
            graph.start(command)
        with GraphClient('experiment_bench', use_sim_time=True) as client:
            for service in ('/stage_driver/home', '/contour_ctrl/run', '/gap_diagnosis/diagnose'):
                client.wait_for_service(service, PATIENCE, graph.check)
            client.trigger('/stage_driver/home', PATIENCE)
            asked = {'experiment': {'duration': len(position) * PERIOD}}
            bag = record_experiment(report, str(file), asked, lockstep=True)
            client.set_parameters('gap_diagnosis', bag=str(bag), allow_motion=True)
            client.trigger('/gap_diagnosis/diagnose', PATIENCE)
            before = answer(report)
            if before['open']:
                client.trigger('/gap_diagnosis/experiment', PATIENCE)
            after = answer(report)
    finally:
        killed = graph.end()
    return {
        'seed': seed, 'effect': case.effect, 'motion': case.motion, 'before': before,
        'after': after, 'killed': killed,
    }  # fmt: skip


def answer(report: Path) -> dict[str, Any]:
    """What the last report says."""
    said = json.loads((report / 'report.json').read_text(encoding='utf-8'))
    rivals = sorted({a for cause in said['causes'] for a in cause['alternatives']})
    return {'verdict': said['verdict'], 'rivals': rivals, 'open': 'experiment' in said}


def words(said: dict[str, Any]) -> str:
    """A verdict and what stands beside it."""
    beside = f' or {", ".join(said["rivals"])}' if said['rivals'] else ''
    return (', '.join(said['verdict']) or 'none') + beside


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, nargs='+', required=True, help='of the cases')
    parser.add_argument('--out', type=Path, default=Path('build/experiment_graph'))
    options = parser.parse_args(arguments)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rows = cases(options.out, options.seeds, lambda n: run_case(n, options.out / str(n)))
    cells = [
        [str(r['seed']), r['effect'], r['motion'], words(r['before']), words(r['after'])]
        for r in rows
    ]
    head = ['seed', 'effect', 'first session', 'before', 'after the experiment']
    print(f'code {commit()}\n\n{table(head, cells)}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
