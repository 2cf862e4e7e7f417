"""Do the intervals of a calibration hold what they say? Held-out places within 95 % intervals.

For each method and stage: the share of held-out places (both axes counted) that lie within 1.96
deviations of the prediction, half the interval's width, and the held-out RMS before and after.
Emulated stages: those below, six trainings with 70 places to learn and 200 others to judge each.
Recorded stage: eight records of a circle, six of one day and two of the next. Of the first day
each fifth of the circle's cells is left out in turn; of all, each record.

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
from stage_core.metrics import SIGMAS

HELD_OUT = 200
LEARNT = 70
SEEDS = range(6)
Rows = tuple[np.ndarray, ...]
"""Command, measured, direction, temperatures; the records also have the label of the session."""


def screw(command: np.ndarray, direction: np.ndarray, heat: np.ndarray) -> np.ndarray:
    """Scale, squareness, straightness, a 4 mm screw cycle and backlash over 50 mm."""
    x, y = command.T
    error_x = 3e-4 * x - 2e-4 * y + 4e-6 * np.sin(2.0 * np.pi * x / 0.004)
    error_y = -2e-4 * y + 0.02 * (x - 0.025) ** 2
    return np.column_stack([error_x, error_y]) + 0.5 * direction * 8e-6


def bowed(command: np.ndarray, direction: np.ndarray, heat: np.ndarray) -> np.ndarray:
    """Guides with bows that no polynomial of low degree holds; no backlash."""
    x, y = (command / 0.025 - 1.0).T
    return 5e-6 * np.column_stack([np.sin(3.0 * x + y), np.cos(4.0 * y) + 0.5 * x])


def still(command: np.ndarray, direction: np.ndarray, heat: np.ndarray) -> np.ndarray:
    """A stage without an error."""
    return np.zeros_like(command)


def warm(command: np.ndarray, direction: np.ndarray, heat: np.ndarray) -> np.ndarray:
    """A screw of steel and a zero of y that follow one temperature, which is measured."""
    x, y = command.T
    return np.column_stack([12e-6 * heat * x + 1e-4 * x, 1e-6 * heat - 2e-4 * y])


def emulated(error: Callable, seed: int) -> tuple[Rows, Rows]:
    """Places to learn and places to judge of one stage, with 0.5 µm of noise."""
    generator = np.random.default_rng(seed)
    command = generator.uniform(0.0, 0.05, (LEARNT + HELD_OUT, 2))
    direction = generator.choice([-1.0, 1.0], command.shape)
    # Warmer than 20 degC by up to 5 K, twice in the places to learn and in those to judge.
    time = np.concatenate([np.arange(n) / n for n in (LEARNT, HELD_OUT)])
    heat = 5.0 * np.sin(2.0 * np.pi * time) ** 2
    measured = command + error(command, direction, heat)
    measured += generator.normal(0.0, 5e-7, measured.shape)
    sensors = 20.0 + heat[:, None] if error is warm else np.empty((len(command), 0))
    rows = (command, measured, direction, sensors)
    return tuple(r[:LEARNT] for r in rows), tuple(r[LEARNT:] for r in rows)


def recorded() -> dict[str, list[tuple[Rows, Rows]]]:
    """The circle's cells of day 1 and the records, each left out once; empty without the data."""
    try:
        files = sorted((data_folder() / 'xy_circle').glob('day*.npz'))
    except StageError:
        return {}
    records = [circle(path) for path in files]
    record = np.repeat(np.arange(len(records)), [len(r[0]) for r in records])[::4]
    rows = [np.concatenate(part)[::4] for part in zip(*records, strict=True)]
    rows.append(np.empty((len(record), 0)))
    day = record < sum(path.stem.startswith('day1') for path in files)
    cells = folds(judged_places(rows[0][day]), 5)
    sessions = [*rows, record]
    return {
        'xy_circle, cells': [
            (tuple(r[day][~mask] for r in rows), tuple(r[day][mask] for r in rows))
            for mask in cells
        ],
        'xy_circle, records': [
            (tuple(r[record != k] for r in sessions), tuple(r[record == k] for r in rows))
            for k in range(len(records))
        ],
    }


def judge(method: str, pairs: list[tuple[Rows, Rows]]) -> np.ndarray:
    """Errors before and after and half intervals [m] of all held-out rows, (3, n, axes)."""
    rows = []
    for learnt, (command, measured, direction, temperatures) in pairs:
        model = make_model(method).fit(*learnt)
        after = measured - model.predict(command, direction, temperatures)
        rows.append([measured - command, after, SIGMAS * model.deviation(command)])
    return np.concatenate(rows, axis=1)


def main() -> int:
    """Print the table."""
    warnings.simplefilter('ignore')
    stages = {f.__name__: [emulated(f, k) for k in SEEDS] for f in (screw, bowed, still, warm)}
    stages |= recorded()
    print(f'{"":18s} {"stage":20s} {"within 95 %":>11s} {"± µm":>9s} {"before":>9s} {"after":>9s}')
    for method in sys.argv[1:] or METHODS:
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
