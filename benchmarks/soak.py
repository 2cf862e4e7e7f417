"""Every soak test, one after the other; what each says stands in docs/results/soak.md.

nice -n 15 .venv/bin/python benchmarks/soak.py --minutes 60 [soak_kill.py ...]
"""

from __future__ import annotations

import argparse
import datetime
import math
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'docs' / 'results' / 'soak.md'
HEAD = """# Soak tests

`make soak` runs `benchmarks/soak.py`, which adds a section here: date, commit, load of the machine
and the last lines of each script. `MINUTES=60`, the default, takes over two hours.
"""
#: The scripts, with the most minutes that each is worth.
LONGEST = {'soak_recorder.py': math.inf, 'soak_kill.py': math.inf, 'soak_states.py': 10.0}
#: What a script says at its end, in lines.
LINES = 12


def main() -> int:
    """Run the scripts and add a section."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--minutes', type=float, default=60.0)
    parser.add_argument('scripts', nargs='*', help='of these only', default=list(LONGEST))
    given = parser.parse_args()
    commit = subprocess.run(
        ['git', 'rev-parse', '--short', 'HEAD'], capture_output=True, text=True, cwd=ROOT
    ).stdout.strip()
    now = datetime.datetime.now(datetime.timezone.utc)
    text = f'\n## {now:%Y-%m-%d %H:%M} UTC, commit {commit}\n'
    failed = False
    for script in given.scripts:
        length = min(given.minutes, LONGEST[script])
        loads = ', '.join(f'{load:.1f}' for load in os.getloadavg())
        done = subprocess.run(
            [sys.executable, f'benchmarks/{script}', '--minutes', f'{length:g}'],
            capture_output=True, text=True, cwd=ROOT,
        )  # fmt: skip
        failed |= done.returncode != 0
        said = (done.stdout + done.stderr).strip().splitlines()[-LINES:]
        verdict = 'passed' if done.returncode == 0 else 'failed'
        text += f'\n`{script} --minutes {length:g}` {verdict}; load before it: {loads}\n\n```\n'
        text += '\n'.join(said) + '\n```\n'
        # Another run may have added its own meanwhile.
        before = PAGE.read_text(encoding='utf-8') if PAGE.exists() else HEAD
        PAGE.write_text(before + text, encoding='utf-8')
        text = ''
    return int(failed)


if __name__ == '__main__':
    sys.exit(main())
