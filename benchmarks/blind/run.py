"""Make blind cases, let the diagnosis loose on their bags, score it.

    python -m benchmarks.blind.run --suite main --cases 40 --seeds development --out build/blind
    python -m benchmarks.blind.run --suite all --seeds report --out build/blind_report

Per case: a bag is written, its truth goes into a sealed file whose hash is printed beforehand,
and the diagnosis runs as a process of its own that gets the bag and the nominal twin file only.
Of the first `--fresh` cases of `main` a second session of the same machine is recorded and
diagnosed with it held out, which tells what the shrinkage is really worth.

Cases run on all cores, or with `--scheduler ADDRESS` on a Dask cluster. A run that was stopped
goes on where it was: the same command again. It ends with `results.md`
and `score.json` in the output directory.
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import json
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

from benchmarks.blind import results
from benchmarks.blind.cases import Case
from benchmarks.blind.machine import NOMINAL
from benchmarks.blind.score import score
from benchmarks.blind.session import visible
from benchmarks.blind.suites import SIZES, case
from benchmarks.blind.trial import run_case
from benchmarks.rows import commit
from session_bags.archive import add_arguments, map_items, where_from
from stage_core.twin_file import TwinFile


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


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--suite', choices=['all', *SIZES], default='main')
    parser.add_argument('--cases', type=int, help='of each suite; default: the size for a report')
    parser.add_argument('--first', type=int, default=0, help='number of the first case')
    parser.add_argument('--seeds', choices=['development', 'report'], default='development')
    add_arguments(parser)
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
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        cases = list(pool.map(visible, drawn))
    TwinFile.from_dict(NOMINAL).save(options.out / 'nominal.yaml')
    run = {'seeds': options.seeds, 'commit': commit(), 'command': ' '.join(sys.argv[1:])}
    print(f'{options.seeds} seeds, code {run["commit"]}, {len(cases)} cases')
    print(f'truth sha256 {seal(cases, options.out)}', flush=True)

    conduct = functools.partial(
        run_case, directory=str(options.out.resolve()), seeds=options.seeds, fresh=options.fresh
    )
    names = [c.folder for c in cases]
    kept, place = options.out / 'kept', where_from(options)
    outcomes = map_items(conduct, names, kept, lambda _: f'fresh {options.fresh}', place)
    failed = [f'{o.item}: {o.error}' for o in outcomes if o.error]
    if failed:
        raise SystemExit(f'run the command again for what failed: {"; ".join(failed)}')
    result = {**run, **score(options.out)}
    (options.out / 'score.json').write_text(json.dumps(result, indent=2), encoding='utf-8')
    page = results.markdown(result)
    (options.out / 'results.md').write_text(page, encoding='utf-8')
    print(page)
    return 0


if __name__ == '__main__':
    sys.exit(main())
