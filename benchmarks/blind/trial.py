"""One case of the blind check: record its session, let the diagnosis loose on it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.blind import baselines
from benchmarks.blind.session import as_session, run_machine
from benchmarks.blind.suites import FRESH_SHIFT, case
from session_bags.writer import write_session

ROOT = Path(__file__).resolve().parents[2]


def run_case(name: str, directory: str, seeds: str, fresh: int) -> dict[str, float]:
    """Record and diagnose a case in its folder; wall times of the diagnoses [s].

    Parameters
    ----------
    name
        Suite and number, as in `Case.folder`.
    fresh
        Cases of `main` whose machine records a second session, to be held out.
    """
    suite, number = name.rsplit('_', 1)
    one = case(suite, int(number), seeds)
    folder = Path(directory) / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    bags = []
    twice = suite == 'main' and int(number) < fresh
    for session_number, shift in enumerate((0, FRESH_SHIFT) if twice else (0,)):
        seed = one.seed + shift
        made = run_machine(one, seed)
        session = as_session(made, seed, one.tracker, one.temperature)
        bags.append(str(write_session(folder / f'bag_{session_number}', session)))
        if session_number == 0:
            plain = baselines.answers(one, made)
            (folder / 'baselines.json').write_text(json.dumps(plain), encoding='utf-8')
    # One thread per process: the cases run beside one another.
    environment = {**os.environ, 'OPENBLAS_NUM_THREADS': '1', 'NUMBA_NUM_THREADS': '1'}
    seconds = {}
    for out, extra in (('out', []), ('fresh', ['--holdout', bags[-1]]))[: len(bags)]:
        command = [sys.executable, '-m', 'gap_diagnosis', 'diagnose', '--quiet', '--no-page']
        command += ['--bag', bags[0], *extra, '--twin', str(Path(directory) / 'nominal.yaml')]
        for effect in one.without:
            command += ['--without', effect]
        started = time.monotonic()
        done = subprocess.run(
            [*command, '--out', str(folder / out)],
            capture_output=True, text=True, env=environment, cwd=ROOT,
        )  # fmt: skip
        seconds[out] = time.monotonic() - started
        if done.returncode:
            (folder / f'{out}_error.txt').write_text(done.stderr)
    for bag in bags:
        shutil.rmtree(bag)
    (folder / 'done.json').write_text(json.dumps({'seconds': seconds}), encoding='utf-8')
    return seconds
