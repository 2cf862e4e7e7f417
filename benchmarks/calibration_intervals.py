"""Do the intervals of a calibration hold what they say? Held-out places within 95 % intervals.

For each method and stage: the share of held-out places (both axes counted) that lie within 1.96
deviations of the prediction, half the interval's width, and the held-out RMS before and after.
Emulated stages: those below, six trainings with 70 places to learn and 200 others to judge each.
Recorded stage: a circle, each fifth of its cells left out in turn, and the same circle on the next
day.

    python benchmarks/calibration_intervals.py [METHOD ...]

The recorded data are looked for at STAGE_DATA or ../shared/data.
"""

import sys
import warnings
from collections.abc import Callable

import numpy as np
from calibration_real_data import circle

from calibrator.models import METHODS, make_model
from calibrator.places import folds, judged_places
from session_bags.measured import data_folder
from stage_core.errors import StageError

HELD_OUT = 200
LEARNT = 70
SEEDS = range(6)
SHOWN = [method for method in METHODS if method != 'thermal']
Rows = tuple[np.ndarray, np.ndarray, np.ndarray]


def screw(command: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Scale, squareness, straightness, a 4 mm screw cycle and backlash over 50 mm."""
    x, y = command.T
    error_x = 3e-4 * x - 2e-4 * y + 4e-6 * np.sin(2.0 * np.pi * x / 0.004)
    error_y = -2e-4 * y + 0.02 * (x - 0.025) ** 2
    return np.column_stack([error_x, error_y]) + 0.5 * direction * 8e-6


def bowed(command: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Guides with bows that no polynomial of low degree holds; no backlash."""
    x, y = (command / 0.025 - 1.0).T
    return 5e-6 * np.column_stack([np.sin(3.0 * x + y), np.cos(4.0 * y) + 0.5 * x])


def still(command: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """A stage without an error."""
    return np.zeros_like(command)


def emulated(error: Callable, seed: int) -> tuple[Rows, Rows]:
    """Places to learn and places to judge of one stage, with 0.5 µm of noise."""
    generator = np.random.default_rng(seed)
    command = generator.uniform(0.0, 0.05, (LEARNT + HELD_OUT, 2))
    direction = generator.choice([-1.0, 1.0], command.shape)
    measured = command + error(command, direction)
    measured += generator.normal(0.0, 5e-7, measured.shape)
    rows = (command, measured, direction)
    return tuple(r[:LEARNT] for r in rows), tuple(r[LEARNT:] for r in rows)


def recorded() -> dict[str, list[tuple[Rows, Rows]]]:
    """The circle's cells of day 1, each left out once, and day 2; empty without the data."""
    try:
        folder = data_folder() / 'xy_circle'
    except StageError:
        return {}
    days = [
        tuple(np.concatenate(part) for part in zip(*map(circle, files), strict=True))
        for files in (sorted(folder.glob(f'day{day}_*.npz')) for day in (1, 2))
    ]
    first, second = (tuple(r[::4] for r in day) for day in days)
    masks = folds(judged_places(first[0]), 5)
    pairs = [tuple(tuple(r[rows] for r in first) for rows in (~mask, mask)) for mask in masks]
    return {'xy_circle, cells': pairs, 'xy_circle, next day': [(first, second)]}


def judge(method: str, pairs: list[tuple[Rows, Rows]]) -> np.ndarray:
    """Errors before and after and half intervals [m] of all held-out rows, (3, n, axes)."""
    rows = []
    for learnt, (command, measured, direction) in pairs:
        model = make_model(method).fit(*learnt)
        after = measured - model.predict(command, direction)
        rows.append([measured - command, after, 1.96 * model.deviation(command)])
    return np.concatenate(rows, axis=1)


def main() -> int:
    """Print the table."""
    warnings.simplefilter('ignore')
    stages = {f.__name__: [emulated(f, k) for k in SEEDS] for f in (screw, bowed, still)}
    stages |= recorded()
    print(f'{"":18s} {"stage":20s} {"within 95 %":>11s} {"± µm":>9s} {"before":>9s} {"after":>9s}')
    for method in sys.argv[1:] or SHOWN:
        for name, pairs in stages.items():
            before, after, half = judge(method, pairs)
            rms = [1e6 * np.sqrt(np.mean(e**2)) for e in (before, after)]
            print(
                f'{method:18s} {name:20s} {100 * np.mean(np.abs(after) <= half):7.1f}% '
                f'{1e6 * np.mean(half):9.2f} {rms[0]:9.2f} {rms[1]:9.2f}',
                flush=True,
            )
    return 0


if __name__ == '__main__':
    sys.exit(main())
