"""Held-out error of the calibration methods on the recorded stages (sources: bags.md).

xy_circle: encoder - reference learnt on the six records of day 1, predicted on the two of day 2,
beside a table over the phase of the lap. `+ offset` refits one constant per axis on the first
tenth of each day-2 record, which is then not scored: offsets drift from day to day.
The perceptron's optimiser is stopped by its limit of iterations, and where it stands then depends
on the rounding of the processor's BLAS kernels: mean and standard deviation over `SEEDS`.
ess_tank: encoder by motor position, 70/30 over positions; approach direction where recorded.

    python benchmarks/calibration_real_data.py        (data at STAGE_DATA or ../shared/data)
"""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from calibrator.compare import compare, table
from calibrator.models import make_model
from calibrator.models.structured import Structured
from calibrator.phase_table import PhaseTable
from calibrator.prepare import approach_direction
from calibrator.samples import Samples
from calibrator.training import Training
from session_bags.measured import data_folder
from stage_core.errors import command_line

METHODS = (
    'identity affine polynomial structured it2fls perceptron gaussian_process gradient_boosting '
    'lolimot'
)
#: Three restarts each, of seeds of their own.
SEEDS = range(0, 12, 3)


def circle(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reference, encoder and direction of one record, every tenth sample."""
    record = np.load(path)
    reference = record['reference']
    keep = slice(None, None, 10)
    return reference[keep], record['encoder'][keep], approach_direction(reference)[keep]


def xy_circle(folder: Path) -> None:
    """Print day-2 errors per axis."""
    day1 = [circle(p) for p in sorted(folder.glob('day1_*.npz'))]
    day2 = [circle(p) for p in sorted(folder.glob('day2_*.npz'))]
    reference, encoder, direction = (np.concatenate(part) for part in zip(*day1, strict=True))
    session = np.repeat(np.arange(len(day1)), [len(record[0]) for record in day1])
    baseline = PhaseTable().fit(reference, encoder)
    predictors = {'phase table': [lambda r, _: baseline.predict(r)]}
    for method in METHODS.split():
        choices = [{'seed': seed} for seed in SEEDS] if method == 'perceptron' else [{}]
        predictors[method] = [
            make_model(method, **options)
            .fit(reference, encoder, direction, session=session)
            .predict
            for options in choices
        ]
    print('xy_circle: learnt on day 1, RMS on the two records of day 2 [µm]')
    heads = [f'{record} {axis}{o}' for record in 'ab' for o in ('', '+off') for axis in 'XY']
    print(f'{"":18s} ' + ' '.join(f'{head:>8s}' for head in heads))
    for name, trained in predictors.items():
        rows = np.array([day2_errors(day2, predict) for predict in trained])
        print_row(name, rows.mean(axis=0))
        if len(rows) > 1:
            print_row(f' ± {len(rows)} seeds', rows.std(axis=0, ddof=1))


def day2_errors(day2: list, predict: Callable) -> list[float]:
    """RMS [µm] per record, without and with an offset refitted, per axis."""
    cells = []
    for r, e, d in day2:
        left = e - predict(r, d)
        prefix = len(left) // 10
        shifted = left[prefix:] - left[:prefix].mean(axis=0)
        for error in (left, shifted):
            cells += list(1e6 * np.sqrt(np.mean(error**2, axis=0)))
    return cells


def print_row(name: str, cells: np.ndarray) -> None:
    """Print one row of the table."""
    print(f'{name:18s} ' + ' '.join(f'{cell:8.1f}' for cell in cells))


def one_axis(command: np.ndarray, measured: np.ndarray, direction: np.ndarray) -> Samples:
    """Samples of one rotary axis; the constant between motor and encoder zero is removed."""
    measured = measured - np.median(measured - command)
    count = len(command)
    return Samples(
        command[:, None],
        measured[:, None],
        direction[:, None],
        np.empty((count, 0)),
        np.arange(count, dtype=float),
        (),
        ('x',),
        0.0,
        True,
    )


def ess_tank(folder: Path) -> None:
    """Print the tables of the two records; lengths are angles, so µm reads µrad."""
    stops = np.load(folder / 'repeatability.npz')
    good = np.abs(stops['encoder']) < 10.0
    samples = one_axis(stops['motor'][good], stops['encoder'][good], stops['approach'][good])
    print(f'ess_tank repeatability: {len(samples)} stops with direction [µrad]')
    print(table(compare(samples, ('identity', 'affine', 'polynomial', 'structured', 'lolimot'))))
    stroke = np.load(folder / 'stroke.npz')
    motor = np.interp(stroke['encoder_t'], stroke['motor_t'], stroke['motor'])
    keep = slice(None, None, 10)
    direction = approach_direction(motor[:, None])[:, 0]
    samples = one_axis(motor[keep], stroke['encoder'][keep], direction[keep])
    print(f'ess_tank stroke: {len(samples)} moving points [µrad]')
    results = compare(samples, METHODS.split())
    print(table(results))
    structured = results['structured']
    if isinstance(structured, Training) and isinstance(structured.model, Structured):
        model = structured.model
        print(f'period {np.degrees(model.state["leads"][0]):.2f} deg; widest terms:')
        rows = sorted(model.parameters(), key=lambda r: -abs(r['value']))[:6]
        for row in rows:
            print(f'  {row["name"]:16s} {1e6 * row["value"]:9.2f} ± {1e6 * row["std"]:.2f} µrad')


@command_line
def main() -> int:
    """Print all tables."""
    folder = data_folder()
    xy_circle(folder / 'xy_circle')
    ess_tank(folder / 'ess_tank')
    return 0


if __name__ == '__main__':
    sys.exit(main())
