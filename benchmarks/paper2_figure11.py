"""Figure 11 of paper 2: the error of one axis with growing sets of terms, on synthetic data.

A delta robot of 1 cm travel with nine temperatures over three days (21 to 25 degC), 13775 points
of which 70 % are fitted; noise as in the paper. Errors are 90 % limits (1.645 sigma) in µm.

    python benchmarks/paper2_figure11.py [--samples 13775]
"""

import argparse
import sys
import time

import numpy as np

from calibrator.stepwise import stepwise
from calibrator.thermal import SETS, derivatives_at, monomials, thermal_terms, up_to

PAPER = {'geometric': 26.6, 'thermal': 0.115, 'correlated': 0.101, 'derivatives': 0.096}
PERIOD = 10.0


def make_robot(samples: int, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Coordinates in [-1, 1], temperatures and the interferometer's X [m]."""
    generator = np.random.default_rng(seed)
    clock = np.arange(samples) * PERIOD
    hours = clock / 3600.0
    room = 23.0 + 1.6 * np.sin(2 * np.pi * hours / 24.0) + 0.3 * np.sin(2 * np.pi * hours / 7.0)
    temperatures = np.empty((samples, 9))
    for sensor in range(9):
        lag = generator.uniform(600.0, 9000.0)
        state = room[0]
        for k in range(samples):
            state += (room[k] - state) * PERIOD / lag
            temperatures[k, sensor] = state
        own = generator.uniform(0.0, 0.3) * np.sin(2 * np.pi * hours / generator.uniform(5, 20))
        temperatures[:, sensor] += own
    q = generator.uniform(-1.0, 1.0, (samples, 3))
    powers = monomials(3)
    geometry = np.column_stack([np.prod(q ** np.array(p), axis=1) for p in powers])
    change = temperatures - temperatures.mean(axis=0)
    x = 5e-3 * q[:, 0] + geometry @ (generator.normal(size=19) * 2e-5)
    x += change @ (generator.normal(size=9) * 2.4e-5)
    pairs = (geometry[:, :, None] * change[:, None, :]).reshape(samples, -1)
    x += pairs @ (generator.normal(size=171) * 9e-9 * (generator.random(171) < 0.3))
    rate = np.gradient(temperatures, PERIOD, axis=0)
    x += rate @ (generator.normal(size=9) * 4e-4)
    x += generator.normal(0.0, 0.055e-6, samples)
    noisy = temperatures + generator.normal(0.0, 2e-4, temperatures.shape)
    return q, noisy, x


def main() -> int:
    """Print the sequence for a split over positions and for one by time."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--samples', type=int, default=13775)
    samples = parser.parse_args().samples
    q, temperatures, x = make_robot(samples)
    clock = np.arange(samples) * PERIOD
    derivatives = np.stack([derivatives_at(clock, sensor, clock) for sensor in temperatures.T], 2)
    first, second = derivatives
    terms = thermal_terms(q, temperatures, first, second, temperatures.mean(axis=0))
    order = np.random.default_rng(1).permutation(samples)
    count = int(0.7 * samples)
    splits = {
        'positions': (order[:count], order[count:]),
        'last 30 % of the time': (np.arange(count), np.arange(count, samples)),
    }
    print(f'{samples} samples, {up_to(terms, SETS[-1]).shape[1]} terms; 90 % limits in µm')
    print(f'{"set":14s} {"paper":>8s}' + ''.join(f' {name:>24s}' for name in splits))
    for group in SETS:
        columns = up_to(terms, group)
        cells = []
        for fitted, held in splits.values():
            started = time.perf_counter()
            fit = stepwise(columns[fitted], x[fitted])
            seconds = time.perf_counter() - started
            error = x[held] - fit.predict(columns[held])
            limit = 1.645e6 * np.sqrt(np.mean(error**2))
            cells.append(f'{limit:10.4f} {len(fit.selected):4d} t {seconds:4.2f} s')
        print(f'{group:14s} {PAPER[group]:8.3f}' + ''.join(f' {cell:>24s}' for cell in cells))
    return 0


if __name__ == '__main__':
    sys.exit(main())
