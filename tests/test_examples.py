"""The example of the pure algorithms runs and finds what it planted."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def test_pure_algorithms(tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / 'examples' / 'pure_algorithms.py'), '--out']
    run = subprocess.run(
        [*command, str(tmp_path)], capture_output=True, text=True, timeout=240, check=False
    )
    assert run.returncode == 0, run.stderr
    lines = run.stdout.splitlines()
    verdict = next(line for line in lines if line.startswith('diagnosis: '))
    named = set(verdict.removeprefix('diagnosis: ').split(': ')[0].split(', '))
    assert named == {'coulomb_friction.x', 'backlash.x', 'nonorthogonality'}
    words = [line.split() for line in lines]
    rms = {word[0]: float(word[1]) for word in words if word[0] in ('identity', 'structured')}
    assert rms['structured'] < 0.3 * rms['identity']
    runs = words[lines.index('circle: contour error RMS of each run [um]') + 1]
    assert float(runs[-1]) < 0.5 * float(runs[0])
    assert (tmp_path / 'calibration.png').read_bytes().startswith(b'\x89PNG')
