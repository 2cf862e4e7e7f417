"""Held-out gain of the default method where there is much to learn.

    python benchmarks/calibration_kept_gain.py --circle FOLDER BAG [BAG ...]

BAG: the calibration bag of a session; the gain is the mean over 20 draws of 30 % of its places.
FOLDER: what `ros2 run session_bags convert_xy_circle --out FOLDER` wrote; the records of day 1 are
learned, the gain is that of day 2. On two commits it says what a choice by data costs.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from calibrator.prepare import prepare
from calibrator.samples import Samples, concatenate
from calibrator.training import default_options, predict, train, twin_leads
from session_bags.reader import read_session

DRAWS = 20


def rms(error: np.ndarray) -> float:
    """Root mean square of all axes."""
    return float(np.sqrt(np.mean(error**2)))


def day(folder: Path, number: int) -> Samples:
    """Samples of the records of a day: command to encoder."""
    bags = sorted(folder.glob(f'day{number}_*'))
    return concatenate([prepare(read_session(bag), 'reference', 'encoder') for bag in bags])


def circle(folder: Path) -> tuple[float, str]:
    """Gain [%] on day 2 of a model of day 1, and what its training said."""
    result = train(day(folder, 1), 'structured')
    held = day(folder, 2)
    error = held.measured - held.command
    left = held.measured - predict(result.model, held)
    return 100.0 * (1.0 - rms(left) / rms(error)), result.line()


def session(bag: str) -> float:
    """Mean gain [%] over draws of a bag's places."""
    content = read_session(bag)
    samples, options = prepare(content), default_options('structured', twin_leads(content))
    results = [train(samples, 'structured', options, seed) for seed in range(DRAWS)]
    return 100.0 * float(np.mean([1.0 - r.after.rms / r.before.rms for r in results]))


def main() -> None:
    """Print a line per stage."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--circle', type=Path, required=True)
    parser.add_argument('bags', nargs='*')
    given = parser.parse_args()
    gain, line = circle(given.circle)
    print(f'xy_circle {gain:.1f} %; its training: {line}', flush=True)
    for bag in given.bags:
        print(f'{bag} {session(bag):.1f} %', flush=True)


if __name__ == '__main__':
    main()
