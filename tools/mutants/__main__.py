"""``python -m tools.mutants draw`` writes the list, ``run`` tries it and writes the table.

A run works in a copy of the tracked files, so the checkout stays as it is, and takes up where an
earlier one stopped: what was found is kept in .cache/mutants.json (remove it to start over).
"""

from __future__ import annotations

import argparse
import subprocess

from .draw import ROOT, draw, store, stored
from .run import Trial, results
from .table import write_table


def main() -> int:
    """Draw or run; 0 unless the arguments are refused."""
    parser = argparse.ArgumentParser(prog='mutants', description=__doc__)
    commands = parser.add_subparsers(dest='command', required=True)
    drawing = commands.add_parser('draw', help='write tools/mutants/drawn.json')
    drawing.add_argument('--count', type=int, default=40)
    drawing.add_argument('--seed', type=int, required=True)
    running = commands.add_parser('run', help='try each mutant on the tests of its package')
    running.add_argument('--seconds', type=float, default=300.0, help='limit of one mutant')
    running.add_argument('--only', default='', help='mutants whose file holds this text')
    arguments = parser.parse_args()
    if arguments.command == 'draw':
        store(draw(arguments.count, arguments.seed), arguments.seed)
        return 0
    dirty = subprocess.run(['git', 'diff', '--quiet', 'HEAD', 'src', 'tests'], cwd=ROOT).returncode
    if dirty:
        parser.error('the tree has changes that no commit holds: commit them first')
    trial = Trial(arguments.seconds)
    for number, mutant in enumerate(stored(), 1):
        if arguments.only in mutant.file:
            print(number, mutant.file, trial.of(mutant).outcome, flush=True)
            write_table(results(), arguments.seconds)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
