"""Fits the probabilities of the diagnosis and writes the page of its calibration.

The blind results get its table of generators that were left out of the fit.

python -m benchmarks.calibrate --sessions 300

Sessions come from three machines that share no code, are diagnosed on all cores, and what each
gives is kept under `build/calibration` for the present state of the code: the same command goes
on where it was stopped, and a larger number adds to what is there. All that is kept is fitted.
"""

from __future__ import annotations

import argparse
import re
import sys
from datetime import date
from pathlib import Path

from benchmarks.calibrate.collect import ROOT, Row, code_hash, collect
from benchmarks.calibrate.fit import CANDIDATES, choose, statements, weights_of
from benchmarks.calibrate.page import headline, markdown, write_weights
from benchmarks.calibrate.sessions import GENERATORS, PER_SEED
from benchmarks.calibrate.spread import spread_of
from session_bags.archive import add_arguments, where_from

WEIGHTS = ROOT / 'src/gap_diagnosis/gap_diagnosis/evidence/calibrated.py'
PAGE = ROOT / 'docs/results/diagnosis_calibration.md'
BLIND = ROOT / 'docs/results/blind_results.md'
BLOCK = re.compile(r'(?<=<!-- left out -->\n).*?(?=\n<!-- end -->)', re.DOTALL)


def main(arguments: list[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='benchmarks.calibrate',
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        '--sessions', type=int, default=300, help='of each generator; 0 fits what is kept'
    )
    parser.add_argument('--out', type=Path, default=Path('build/calibration'))
    add_arguments(parser)
    options = parser.parse_args(arguments)
    seeds = range(1, 1 + -(-options.sessions // PER_SEED))
    items = [f'{generator}-{seed}' for seed in seeds for generator in GENERATORS]
    code = code_hash()
    rows, failed = collect(items, options.out / code, where_from(options))
    for line in failed:
        print(f'failed: {line}', file=sys.stderr)
    weights = {kind: _weights(rows, kind) for kind in CANDIDATES}
    facts = {
        'code': code,
        'date': date.today().isoformat(),
        'sessions': {g: sum(row['generator'] == g for row in rows) for g in GENERATORS},
        'seeds': f'1 to {max(row["seed"] for row in rows)}',
    }
    spread = spread_of(rows)
    write_weights(WEIGHTS, weights, spread, facts)
    PAGE.write_text(markdown(rows, weights, spread, facts), encoding='utf-8')
    block = headline(rows, weights, facts)
    BLIND.write_text(BLOCK.sub(lambda _: block, BLIND.read_text('utf-8')), encoding='utf-8')
    print(f'{len(rows)} sessions, code {code}: {WEIGHTS} and {PAGE}')
    return 0


def _weights(rows: list[Row], kind: str) -> dict[str, float]:
    found = statements(rows, kind)
    return weights_of(found, choose(found, CANDIDATES[kind]))


if __name__ == '__main__':
    sys.exit(main())
