"""Retraining from an archive of small bags: one process, two processes, a local Dask cluster.

Run: .venv/bin/python benchmarks/archive_cluster.py [--bags 200]

One bag is bad. On the cluster of two workers the run is killed (SIGKILL) once a third of the bags
is done, and run again.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from distributed import LocalCluster

from calibrator import model_file
from session_bags.writer import write_session
from stage_core import topics
from stage_core.session import Series, Session, by_topic

START = 1_700_000_000_000_000_000
RESTS = 20


def session(seed: int) -> Session:
    """Twenty rests of 0.3 s at 500 Hz on a stage with a scale error and a 4 mm screw cycle."""
    generator = np.random.default_rng(seed)
    command = np.repeat(generator.uniform(0.0, 0.05, (RESTS, 2)), 150, axis=0)
    stamps = START + np.arange(len(command)) * 2_000_000
    table = command * (1.0 + 2e-4) + 4e-6 * np.sin(2.0 * np.pi * command / 0.004)
    points = table[::5] + generator.normal(0.0, 5e-7, table[::5].shape)
    return Session(
        'archive',
        by_topic(
            Series.per_axis(topics.REFERENCE, stamps, position=command),
            Series.per_axis(topics.JOINT_STATES, stamps, position=command),
            Series.points(topics.TRACKER_POINT, stamps[::5], points),
        ),
    )


def command(name: str, *extra: str) -> list[str]:
    """The command line of a retraining whose results and model are called `name`."""
    words = ['--bag', 'archive', '--results', name, '--out', f'{name}.json']
    return [sys.executable, '-m', 'calibrator.retrain_offline', *words, *extra]


def timed(folder: Path, name: str, *extra: str) -> float:
    """Seconds of a whole run; prints what it printed last."""
    begin = time.monotonic()
    done = subprocess.run(
        command(name, *extra), cwd=folder, capture_output=True, text=True, check=True
    )
    seconds = time.monotonic() - begin
    skipped = [line for line in done.stderr.splitlines() if line.startswith('skipped')]
    print(f'{name:12s} {seconds:6.1f} s   {done.stdout.splitlines()[0]}; {len(skipped)} skipped')
    return seconds


def main() -> int:
    """Print times and whether the models are the same."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--bags', type=int, default=200)
    count = parser.parse_args().bags
    print(f'load of the machine {os.getloadavg()[0]:.0f} on {os.cpu_count()} cores')
    with tempfile.TemporaryDirectory() as place_of_all:
        folder = Path(place_of_all)
        for number in range(count):
            write_session(folder / 'archive' / f'session_{number:04d}', session(number))
        bad = folder / 'archive' / 'session_0007' / 'session_0007_0.mcap'
        bad.write_bytes(bad.read_bytes()[:500])
        timed(folder, 'one', '--jobs', '1')
        timed(folder, 'two', '--jobs', '2')
        with LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=':0'
        ) as cluster:
            place = ('--scheduler', cluster.scheduler_address)
            timed(folder, 'cluster', *place)
            run = subprocess.Popen(command('killed', *place), cwd=folder)
            while run.poll() is None and len(list((folder / 'killed').glob('*.json'))) < count / 3:
                time.sleep(0.01)
            run.kill()
            run.wait()
            kept = len(list((folder / 'killed').glob('*.json')))
            print(f'killed with {kept} of {count} bags done; the same command again:')
            timed(folder, 'killed', *place)
        names = ('one', 'two', 'cluster', 'killed')
        models = [model_file.load(folder / f'{name}.json').model.to_dict() for name in names]
        same = all(model == models[0] for model in models)
        print(f'the four models are {"the same" if same else "DIFFERENT"}')
        return 0 if same else 1


if __name__ == '__main__':
    sys.exit(main())
