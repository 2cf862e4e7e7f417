"""Make blind cases, let the diagnosis loose on their bags, score it.

    python -m benchmarks.blind.run --cases 40 --seeds development --out build/blind

Per case: a bag is written, its truth goes into a sealed file whose hash is listed beforehand,
and the diagnosis runs as a process of its own that gets the bag and the nominal twin file only.
`--fresh` records a second session of each machine and diagnoses with it held out, which tells
what the shrinkage is really worth.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from benchmarks.blind.cases import REPORT_SEEDS, Case, draw
from benchmarks.blind.machine import NOMINAL, Recording, record
from benchmarks.blind.score import score, text
from session_bags.writer import write_session
from stage_core import topics
from stage_core.session import Series, Session
from stage_core.twin_file import TwinFile

EPOCH = 1_760_000_000_000_000_000


def as_session(recording: Recording, seed: int) -> Session:
    """A recording with stamps at any epoch; stage stamps jitter by up to 20 µs."""
    generator = np.random.default_rng(seed + 1)
    start = EPOCH + int(generator.integers(0, 10**15))

    def stamps(seconds: np.ndarray, jitter: float) -> np.ndarray:
        noise = generator.uniform(-jitter, jitter, len(seconds))
        return start + np.rint((seconds + noise) * 1e9).astype(np.int64)

    ticks = stamps(recording.time, 20e-6)

    def joints(topic: str, **columns: np.ndarray) -> Series:
        return Series(
            topic,
            ticks,
            {
                f'{name}.{axis}': column[:, i]
                for name, column in columns.items()
                for i, axis in enumerate(recording.axes)
            },
        )

    points = np.zeros((len(recording.tracker), 3))
    points[:, : len(recording.axes)] = recording.tracker
    series = {
        topics.REFERENCE: joints(
            topics.REFERENCE,
            position=recording.reference,
            velocity=recording.reference_velocity,
        ),
        topics.COMMAND: joints(
            topics.COMMAND, velocity=recording.velocity_command, effort=recording.force
        ),
        topics.JOINT_STATES: joints(
            topics.JOINT_STATES, position=recording.encoder, velocity=recording.filtered_velocity
        ),
        topics.TRACKER_POINT: Series(
            topics.TRACKER_POINT,
            stamps(recording.tracker_time, 0.0),
            {'x': points[:, 0], 'y': points[:, 1], 'z': points[:, 2]},
        ),
    }
    for i, axis in enumerate(recording.axes):
        series[topics.temperature_key(f'screw_{axis}')] = Series(
            topics.TEMPERATURE,
            stamps(recording.temperature_time, 0.0),
            {'temperature': recording.temperature[:, i]},
        )
    return Session('blind', series)


def visible(case: Case) -> Case:
    """The case with those effects expected that change what the recorder holds.

    The machine is run once more without each effect. Below 0.1 µm of the encoder (means over
    20 ms: its last count is chance), a third of the tracker's noise, and 0.3 N of force (means
    over 0.1 s), an effect is below the noise and must not be named. A coarse encoder is seen.
    """
    whole = record(case.truth, case.seed, case.axes, case.duration, case.rate, case.noise)
    seen = []
    for name in case.planted:
        rest = {n: v for n, v in case.truth.items() if n != name}
        less = record(rest, case.seed, case.axes, case.duration, case.rate, case.noise)
        force = whole.force - less.force
        encoder = whole.encoder - less.encoder
        changes = (
            _rms_of_means(encoder, 20) / 0.1e-6,
            _rms_of_means(whole.tracker - less.tracker, 1) / 0.33e-6,
            _rms_of_means(force, 100) / 0.3,
            2.0 if name.startswith('encoder_quantisation') else 0.0,
        )
        if max(changes) > 1.0:
            seen.append(name)
    return replace(case, planted=tuple(seen))


def _rms_of_means(signal: np.ndarray, size: int) -> float:
    """Largest RMS over the axes (n, a) of means over `size` samples."""
    whole = signal[: len(signal) // size * size]
    means = whole.reshape(-1, size, signal.shape[1]).mean(axis=1)
    return float(np.sqrt(np.mean(means**2, axis=0)).max())


def run_case(case: Case, directory: Path, fresh: bool) -> None:
    """Record, seal and diagnose one case in its folder."""
    folder = directory / f'case_{case.number:04d}'
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    sessions = [case.seed] + ([case.seed + 7_000_000] if fresh else [])
    bags = []
    for number, seed in enumerate(sessions):
        made = record(case.truth, seed, case.axes, case.duration, case.rate, case.noise)
        bags.append(str(write_session(folder / f'bag_{number}', as_session(made, seed))))
    environment = {**os.environ, 'OPENBLAS_NUM_THREADS': '1', 'NUMBA_NUM_THREADS': '1'}
    for name, extra in (('out', []), ('fresh', ['--holdout', bags[-1]])):
        if name == 'fresh' and not fresh:
            continue
        command = [sys.executable, '-m', 'gap_diagnosis', 'diagnose', '--quiet']
        command += ['--bag', bags[0], *extra, '--twin', str(directory / 'nominal.yaml')]
        command += ['--out', str(folder / name)]
        done = subprocess.run(command, capture_output=True, text=True, env=environment)
        if done.returncode:
            (folder / f'{name}_error.txt').write_text(done.stderr)
    for bag in bags:
        shutil.rmtree(bag)
    print('.', end='', file=sys.stderr, flush=True)


def seal(cases: list[Case], directory: Path) -> str:
    """Write the truth, readable by the scorer alone; returns the hash to be published."""
    content = json.dumps([{**asdict(c), 'expected': c.expected} for c in cases], sort_keys=True)
    path = directory / 'truth.sealed.json'
    path.write_text(content, encoding='utf-8')
    path.chmod(0o600)
    digest = hashlib.sha256(content.encode()).hexdigest()
    (directory / 'truth.sha256').write_text(digest + '\n', encoding='utf-8')
    return digest


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--cases', type=int, default=20)
    parser.add_argument('--first', type=int, default=0, help='number of the first case')
    parser.add_argument('--seeds', choices=['development', 'report'], default='development')
    parser.add_argument('--processes', type=int, default=2)
    parser.add_argument('--fresh', action='store_true')
    parser.add_argument('--out', type=Path, default=Path('build/blind'))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    offset = REPORT_SEEDS if options.seeds == 'report' else 0
    numbers = range(options.first, options.first + options.cases)
    cases = [visible(draw(n, offset + n)) for n in numbers]
    TwinFile.from_dict(NOMINAL).save(options.out / 'nominal.yaml')
    print(f'{options.seeds} seeds; truth sha256 {seal(cases, options.out)}')
    with ThreadPoolExecutor(options.processes) as pool:
        list(pool.map(lambda c: run_case(c, options.out, options.fresh), cases))
    print(file=sys.stderr)
    result = score(options.out)
    (options.out / 'score.json').write_text(json.dumps(result, indent=2), encoding='utf-8')
    print(text(result))
    return 0


if __name__ == '__main__':
    sys.exit(main())
