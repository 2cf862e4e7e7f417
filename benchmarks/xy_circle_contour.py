"""The recorded XY stage: contour error, friction, and what learning could take away.

    python benchmarks/xy_circle_contour.py

Reads xy_circle below STAGE_DATA (or ../shared/data). The records are one lap of a circle of
120 mm radius in 15 s; command in volts, so friction and mass are in volts too.
"""

from __future__ import annotations

import numpy as np

from contour_ctrl.contour_error import of_record
from contour_ctrl.curves import circle
from contour_ctrl.figures import figures
from contour_ctrl.friction import lugre_force
from contour_ctrl.identify_friction import identify
from contour_ctrl.path import PathTable
from hra_curves.arc_length import ArcLength
from session_bags.measured import data_folder
from stage_core.errors import StageError, command_line

PERIOD = 0.001
BINS = 360
NAMES = ('day1_a', 'day1_b', 'day1_c', 'day1_d', 'day1_e', 'day1_f', 'day2_a', 'day2_b')


def fitted_circle(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre (2,) and radius [m] of the reference by least squares."""
    matrix = np.column_stack([2.0 * points, np.ones(len(points))])
    solution = np.linalg.lstsq(matrix, np.sum(points**2, axis=1), rcond=None)[0]
    return solution[:2], float(np.sqrt(solution[2] + solution[:2] @ solution[:2]))


def contour_of(reference: np.ndarray, encoder: np.ndarray) -> np.ndarray:
    """Signed contour error (n,) [m] against the fitted circle, in the sense of travel."""
    centre, radius = fitted_circle(reference)
    path = PathTable.from_curve(ArcLength.of(circle(radius, (centre[0], centre[1]))))
    angle = np.unwrap(np.arctan2(*(reference - centre).T[::-1]))
    sense = 1.0 if angle[-1] > angle[0] else -1.0
    return sense * of_record(path, radius * np.mod(angle, 2.0 * np.pi), encoder)


def by_place(others: list[dict[str, np.ndarray]], record: dict[str, np.ndarray]) -> np.ndarray:
    """Mean error (n, 2) of other records at the angle of each sample: what learning repeats."""
    tables = []
    for other in others:
        places = place(other['reference'])
        error = other['reference'] - other['encoder']
        counts = np.bincount(places, minlength=BINS)
        tables.append(
            np.column_stack(
                [np.bincount(places, error[:, axis], BINS) / counts for axis in range(2)]
            )
        )
    return np.asarray(np.mean(tables, axis=0)[place(record['reference'])])


def place(points: np.ndarray) -> np.ndarray:
    """Bin (n,) of the angle on the circle."""
    angle = np.arctan2(*(points - fitted_circle(points)[0]).T[::-1])
    return (np.mod(angle, 2.0 * np.pi) / (2.0 * np.pi) * BINS).astype(int) % BINS


def by_friction(others: list[dict[str, np.ndarray]], record: dict[str, np.ndarray]) -> np.ndarray:
    """Error (n, 2) that friction, speed and acceleration explain, fitted on other records."""
    result = np.empty((len(record['t']), 2))
    for axis in range(2):
        rows = np.vstack([regressors(o['reference'][:, axis]) for o in others])
        # A constant of its own for each record: offsets drift, and friction is not to blame.
        error = np.concatenate([centred(o['reference'] - o['encoder'])[:, axis] for o in others])
        solution = np.linalg.lstsq(rows, error, rcond=None)[0]
        result[:, axis] = regressors(record['reference'][:, axis]) @ solution
    return result


def centred(values: np.ndarray) -> np.ndarray:
    """Values without their mean."""
    return np.asarray(values - values.mean(axis=0))


def regressors(position: np.ndarray) -> np.ndarray:
    """Coulomb friction with presliding, speed, acceleration of a reference (n,)."""
    velocity = np.gradient(position, PERIOD)
    unit = np.array([1.0, 1.0, 1.0, 1.0 / 1e-4, 0.0, 0.0])
    friction = lugre_force(unit, velocity, PERIOD)
    return centred(np.column_stack([friction, velocity, np.gradient(velocity, PERIOD)]))


def show(name: str, record: dict[str, np.ndarray], learned: np.ndarray) -> None:
    """Print RMS before and after."""
    reference, encoder = record['reference'], record['encoder']
    before = figures(reference - encoder, contour_of(reference, encoder))
    after = figures(reference - encoder - learned, contour_of(reference, encoder + learned))
    print(
        f'{name}: X {1e6 * before.x.rms:.0f} -> {1e6 * after.x.rms:.0f}, '
        f'Y {1e6 * before.y.rms:.0f} -> {1e6 * after.y.rms:.0f}, contour '
        f'{1e6 * before.contour.rms:.0f} -> {1e6 * after.contour.rms:.0f}'
    )


@command_line
def main() -> int:
    """Print the three parts."""
    root = data_folder() / 'xy_circle'
    records = {name: dict(np.load(root / f'{name}.npz')) for name in NAMES}
    errors = {name: r['reference'] - r['encoder'] for name, r in records.items()}
    for name, r in records.items():
        print(
            f'{name}: '
            + figures(errors[name], contour_of(r['reference'], r['encoder'])).sentence()
        )
    print('\nfriction, in volts, from encoder and command; forces of the tool as extra terms:')
    for name in ('day1_a', 'day2_a'):
        r = records[name]
        for axis, letter in enumerate('xy'):
            try:
                found = identify(
                    r['encoder'][:, axis],
                    r['command'][:, axis],
                    PERIOD,
                    0.01,
                    r['contact_force'][:, :2],
                )
            except StageError as error:
                print(f'{name} {letter}: {error}')
                continue
            print(f'{name} {letter}: {found.sentence()}')
    print(
        '\npredicted, µm RMS: what is left when the error that the other records of day 1 show at '
        'the same place of\nthe circle (a), or at the same friction, speed and acceleration (b), '
        'is taken away'
    )
    for name in NAMES:
        others = [records[n] for n in NAMES if n.startswith('day1') and n != name]
        r = records[name]
        for key, learned in (('a', by_place(others, r)), ('b', by_friction(others, r))):
            show(f'{name} {key}', r, learned)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
