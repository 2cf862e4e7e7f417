"""Makes development cases and scores a diagnosis on them.

python -m benchmarks.generators make --generator handmade --seed 7 --cases 40 --out DIR
python -m benchmarks.generators score --out DIR [--cmd 'PYTHON -m gap_diagnosis diagnose']
"""

from __future__ import annotations

import argparse
import importlib
import shutil
import sys
import time
from pathlib import Path

from .cases import draw_cases, write_case
from .record import Generator
from .score import score

GENERATORS = {'handmade': '.handmade', 'mujoco': '.mujoco_stage'}


def generator_of(name: str) -> Generator:
    """The module of a generator, imported on demand: it compiles or needs what may be absent."""
    return importlib.import_module(GENERATORS[name], __package__)  # type: ignore[return-value]


def make(options: argparse.Namespace) -> int:
    """Writes the cases of a seed; those that are there already stay unless `--again`."""
    started = time.monotonic()
    cases = draw_cases(generator_of(options.generator), options.seed, options.cases, options.only)
    for case in cases:
        folder = options.out / case.name
        if options.again or not (folder / 'truth.json').exists():
            shutil.rmtree(folder, ignore_errors=True)
            write_case(case, folder)
        shown = ', '.join(f'{name} {gap:.3g}' for name, gap in case.gap.items())
        spent = time.monotonic() - started
        print(
            f'{spent:6.1f} s  {case.name}  {"+".join(case.reference.kinds)}  {shown}', flush=True
        )
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='benchmarks.generators',
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(required=True)
    maker = commands.add_parser('make', help='draw, simulate and write cases')
    maker.add_argument('--generator', choices=tuple(GENERATORS), required=True)
    maker.add_argument('--seed', type=int, required=True)
    maker.add_argument('--cases', type=int, default=40)
    maker.add_argument('--only', default='', help='single effects of this name only')
    maker.add_argument('--out', type=Path, required=True)
    maker.add_argument('--again', action='store_true', help='write cases again that are there')
    maker.set_defaults(run=make)
    scorer = commands.add_parser('score', help='diagnose the cases and score the reports')
    scorer.add_argument('--out', type=Path, nargs='+', required=True)
    scorer.add_argument('--cmd', default=f'{sys.executable} -m gap_diagnosis diagnose')
    scorer.add_argument('--jobs', type=int, default=1)
    scorer.add_argument('--again', action='store_true', help='diagnose again what has a report')
    scorer.set_defaults(run=lambda o: score(o.out, o.cmd, o.jobs, o.again))
    options = parser.parse_args(arguments)
    return int(options.run(options))


if __name__ == '__main__':
    sys.exit(main())
