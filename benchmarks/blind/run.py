"""Make blind cases, let the diagnosis loose on their bags, score it.

    python -m benchmarks.blind.run --suite main --cases 40 --seeds development --out build/blind
    python -m benchmarks.blind.run --suite all --seeds report --out build/blind_report

Per case: a bag is written, its truth goes into a sealed file whose hash is printed beforehand,
and the diagnosis runs as a process of its own that gets the bag and the nominal twin file only.
Of the first `--fresh` cases of `main` a second session of the same machine is recorded and
diagnosed with it held out, which tells what the shrinkage is really worth.

A run that was stopped goes on where it was: the same command again. It ends with `results.md`
and `score.json` in the output directory.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

from benchmarks.blind import baselines, results
from benchmarks.blind.cases import Case
from benchmarks.blind.machine import NOMINAL
from benchmarks.blind.score import score
from benchmarks.blind.session import as_session, run_machine, visible
from benchmarks.blind.suites import FRESH_SHIFT, SIZES, case
from session_bags.writer import write_session
from stage_core.twin_file import TwinFile

ROOT = Path(__file__).resolve().parents[2]
DONE = 'done.json'


def run_case(one: Case, directory: Path, fresh: bool) -> None:
    """Record and diagnose one case in its folder, unless that is done already."""
    folder = directory / one.folder
    if (folder / DONE).exists():
        return
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    bags = []
    for number, seed in enumerate((one.seed, one.seed + FRESH_SHIFT)[: 2 if fresh else 1]):
        made = run_machine(one, seed)
        session = as_session(made, seed, one.tracker, one.temperature)
        bags.append(str(write_session(folder / f'bag_{number}', session)))
        if number == 0:
            plain = baselines.answers(one, made)
            (folder / 'baselines.json').write_text(json.dumps(plain), encoding='utf-8')
    # One thread per process: the cases run beside one another.
    environment = {**os.environ, 'OPENBLAS_NUM_THREADS': '1', 'NUMBA_NUM_THREADS': '1'}
    seconds = {}
    for name, extra in (('out', []), ('fresh', ['--holdout', bags[-1]]))[: len(bags)]:
        command = [sys.executable, '-m', 'gap_diagnosis', 'diagnose', '--quiet', '--no-page']
        command += ['--bag', bags[0], *extra, '--twin', str(directory / 'nominal.yaml')]
        for effect in one.without:
            command += ['--without', effect]
        started = time.monotonic()
        done = subprocess.run(
            [*command, '--out', str(folder / name)],
            capture_output=True, text=True, env=environment,
        )  # fmt: skip
        seconds[name] = time.monotonic() - started
        if done.returncode:
            (folder / f'{name}_error.txt').write_text(done.stderr)
    for bag in bags:
        shutil.rmtree(bag)
    (folder / DONE).write_text(json.dumps({'seconds': seconds}), encoding='utf-8')


def seal(cases: list[Case], directory: Path) -> str:
    """Write the truth, readable by the scorer alone; returns the hash to be published.

    Raises
    ------
    SystemExit
        If the directory holds another run, whose cases would be mixed with these.
    """
    content = json.dumps([{**asdict(c), 'expected': c.expected} for c in cases], sort_keys=True)
    digest = hashlib.sha256(content.encode()).hexdigest()
    path, published = directory / 'truth.sealed.json', directory / 'truth.sha256'
    if published.exists() and published.read_text(encoding='utf-8').strip() != digest:
        raise SystemExit(f'{directory} holds another run: give another --out or remove it')
    path.write_text(content, encoding='utf-8')
    path.chmod(0o600)
    published.write_text(digest + '\n', encoding='utf-8')
    return digest


def commit() -> str:
    """Hash of the code that is run, with a mark where files differ from it."""

    def git(*words: str) -> str:
        done = subprocess.run(['git', *words], cwd=ROOT, capture_output=True, text=True)
        return done.stdout.strip()

    changed = git('status', '--porcelain', '--untracked-files=no')
    return git('rev-parse', '--short=12', 'HEAD') + (' with changes' if changed else '')


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--suite', choices=['all', *SIZES], default='main')
    parser.add_argument('--cases', type=int, help='of each suite; default: the size for a report')
    parser.add_argument('--first', type=int, default=0, help='number of the first case')
    parser.add_argument('--seeds', choices=['development', 'report'], default='development')
    parser.add_argument('--processes', type=int, default=2)
    parser.add_argument('--fresh', type=int, default=60, help='cases of main with a fresh session')
    parser.add_argument('--out', type=Path, default=Path('build/blind'))
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    suites = list(SIZES) if options.suite == 'all' else [options.suite]
    drawn = [
        case(suite, options.first + n, options.seeds)
        for suite in suites
        for n in range(SIZES[suite] if options.cases is None else options.cases)
    ]
    with ThreadPoolExecutor(options.processes) as pool:
        cases = list(pool.map(visible, drawn))
    TwinFile.from_dict(NOMINAL).save(options.out / 'nominal.yaml')
    run = {'seeds': options.seeds, 'commit': commit(), 'command': ' '.join(sys.argv[1:])}
    print(f'{options.seeds} seeds, code {run["commit"]}, {len(cases)} cases')
    print(f'truth sha256 {seal(cases, options.out)}', flush=True)

    def one(job: tuple[int, Case]) -> None:
        number, item = job
        run_case(item, options.out, item.suite == 'main' and number < options.fresh)
        print(f'{number + 1}/{len(cases)} {item.folder}', file=sys.stderr, flush=True)

    with ThreadPoolExecutor(options.processes) as pool:
        list(pool.map(one, enumerate(cases)))
    result = {**run, **score(options.out)}
    (options.out / 'score.json').write_text(json.dumps(result, indent=2), encoding='utf-8')
    page = results.markdown(result)
    (options.out / 'results.md').write_text(page, encoding='utf-8')
    print(page)
    return 0


if __name__ == '__main__':
    sys.exit(main())
