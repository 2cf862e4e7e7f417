"""Is a drift of one hour learned as an error of the stage? Emulated stages that nobody warms.

Each row: how many of the trainings are taken, and how many of these make another session of the
stage worse by more than 2 %, with the times of the samples forgotten (shuffled) and with them.

    python benchmarks/calibration_drift.py [--seeds 20] [--method affine]
"""

import argparse
import warnings
from dataclasses import replace

import numpy as np

from calibrator.prepare import approach_direction
from calibrator.samples import Samples
from calibrator.training import predict, train
from stage_bringup.plan import calibration_grid

HALF, NOISE, DRIFT = 0.03, 5e-7, 3e-6
WORSE = 1.02
#: A raster of 7 x 7 places, each visited once.
LINES = np.linspace(-HALF, HALF, 7)
PLACES = {
    'grid of 4, there and back': calibration_grid(HALF, 4),
    '60 places at random': np.random.default_rng(9).uniform(-HALF, HALF, (60, 2)),
    'raster of 7, once': np.array([(x, y) for y in LINES for x in LINES]),
}


def screw(command: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Scale, squareness, straightness, a screw cycle and backlash."""
    x, y = command.T
    error_x = 3e-4 * x - 1e-4 * y + 4e-6 * np.sin(2.0 * np.pi * x / 0.004)
    return np.column_stack([error_x, -2e-4 * y + 0.02 * x**2]) + 4e-6 * direction


def drift(kind: str, generator: np.random.Generator, count: int) -> np.ndarray:
    """How the zero of the stage moves within a session, (count, 2) [m], another way each time."""
    time, way = np.linspace(0.0, 1.0, count)[:, None], generator.normal(size=2)
    way *= DRIFT / np.linalg.norm(way)
    if kind == 'linear':
        return time * way
    if kind == 'to and fro':
        return (
            np.sin(2.0 * np.pi * (generator.uniform(0.5, 2.0) * time + generator.uniform())) * way
        )
    if kind == 'at random':
        steps = generator.normal(size=(count, 2))
        return DRIFT * np.cumsum(steps, axis=0) / np.sqrt(count)
    return np.zeros((count, 2))


def session(places: np.ndarray, size: float, kind: str, generator: np.random.Generator) -> Samples:
    """Visits to the places, in their order."""
    count = len(places)
    direction = approach_direction(np.vstack([[-0.04, -0.04], places]))[1:]
    error = size * screw(places, direction) + drift(kind, generator, count)
    error += generator.normal(0.0, NOISE, places.shape)
    times, none = 3.0 * np.arange(count, dtype=float), np.empty((count, 0))
    axes = ('x', 'y')
    return Samples(places, places + error, direction, none, times, (), axes, 0.0, True)


def judged(samples: Samples, other: Samples, method: str) -> tuple[bool, bool]:
    """Whether a model is taken, and whether it makes the other session worse."""
    found = train(samples, method)
    before = other.measured - other.command
    after = other.measured - predict(found.model, other)
    worse = bool(np.sum(after**2) > WORSE**2 * np.sum(before**2))
    return found.gain.proven, found.gain.proven and worse


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=20)
    parser.add_argument('--method', default='affine')
    given = parser.parse_args()
    warnings.simplefilter('ignore')
    print('| places | error of the stage | drift of 3 µm | times forgotten | with times |')
    print('|---|---|---|---|---|')
    for name, places in PLACES.items():
        for size in (0.0, 1.0):
            for kind in ('none', 'linear', 'to and fro', 'at random'):
                counts = np.zeros((2, 2), dtype=int)
                for seed in range(given.seeds):
                    generator = np.random.default_rng(seed)
                    samples = session(places, size, kind, generator)
                    elsewhere = generator.uniform(-HALF, HALF, (200, 2))
                    other = session(elsewhere, size, kind, generator)
                    mixed = replace(samples, times=generator.permutation(samples.times))
                    counts += [judged(s, other, given.method) for s in (mixed, samples)]
                cells = ' | '.join(f'{taken} taken, {worse} worse' for taken, worse in counts)
                stage = '10 µm' if size else 'none'
                print(f'| {name} | {stage} | {kind} | {cells} |', flush=True)


if __name__ == '__main__':
    main()
