"""Wall time of one diagnosis of a 60 s session, two axes at 1 kHz, with everything the user gets.

The session is of the blind machine (`benchmarks/blind`), the command is the user's own, with page.
The first run compiles its kernels into an empty cache, as in a new checkout; the second does not.

Run: .venv/bin/python benchmarks/bench_diagnosis.py [--seconds 60] [--rate 1000]
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.blind.machine import NOMINAL, record
from benchmarks.blind.session import as_session
from session_bags.writer import write_session

SEED = 17  # of the development range
PLANTED = {
    'asymmetric_friction.x': {
        'coulomb_positive': 9.0, 'coulomb_negative': 6.0, 'presliding': 4e-6,
        'viscous_positive': 20.0, 'viscous_negative': 35.0,
    },
    'force_ripple.y': {'ripple': 3.0, 'ripple_phase': 0.8},
    'backlash.y': {'width': 9e-6},
    'cyclic_pitch_error.x': {'amplitude': 3e-6, 'phase': 0.4},
    'nonorthogonality': {'angle': 1.2e-4},
}  # fmt: skip


def run(folder: Path) -> None:
    """One diagnosis as a process of its own, with what it says and what it took."""
    words = ['--bag', str(folder / 'bag'), '--twin', str(folder / 'twin.yaml')]
    command = [sys.executable, '-m', 'gap_diagnosis', 'diagnose', *words]
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.Popen(
        [*command, '--out', str(folder / 'out')],
        env={**os.environ, 'NUMBA_CACHE_DIR': str(folder / 'kernels')},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert done.stderr is not None and done.stdout is not None
    for line in done.stderr:
        print(f'{time.monotonic() - started:7.1f} s  {line.strip()}')
    print(f'           {done.stdout.read().strip()}')
    if done.wait() != 0:
        raise SystemExit(done.returncode)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(
        f'{time.monotonic() - started:7.1f} s wall, {cpu:.1f} s CPU, '
        f'{after.ru_maxrss / 1024:.0f} MiB'
    )


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--seconds', type=float, default=60.0)
    parser.add_argument('--rate', type=float, default=1000.0, help='of the tracker [Hz]')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recording = record(PLANTED, SEED, ('x', 'y'), options.seconds, options.rate)
        write_session(folder / 'bag', as_session(recording, SEED))
        (folder / 'twin.yaml').write_text(yaml.safe_dump(NOMINAL))
        print(f'{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}')
        for what in ('first run', 'second run'):
            print(what)
            run(folder)
    return 0


if __name__ == '__main__':
    sys.exit(main())
