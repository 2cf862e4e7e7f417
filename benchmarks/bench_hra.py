"""Time of the totally positive algebra against numpy.linalg.solve and lstsq, as ratios.

Both sides start from the nodes: the matrix or its factors are made in the time measured. Beside
each time stands the relative error of the solution against 100 digits, for what the time buys.
"""

from __future__ import annotations

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import time
from collections.abc import Callable

import numpy as np

from hra_curves import (
    Bernstein,
    collocation_matrix,
    exact,
    factorise,
    least_squares,
    parameter_nodes,
    solve,
)

BASIS = Bernstein()
REPEATS = 5


def best_time(function: Callable[[], object], budget: float = 0.1) -> float:
    """Smallest mean time of a call, seconds, over a few rounds."""
    function()
    start = time.perf_counter()
    function()
    calls = max(1, int(budget / REPEATS / max(time.perf_counter() - start, 1e-7)))
    rounds = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        for _ in range(calls):
            function()
        rounds.append((time.perf_counter() - start) / calls)
    return min(rounds)


def main() -> None:
    """Print both tables."""
    generator = np.random.default_rng(0)
    print('interpolation       numpy.linalg.solve       HRA (TNSolve)        time ratio')
    print('  n                    time     error       time     error      HRA / numpy')
    for size in (10, 20, 50, 100, 200):
        nodes = parameter_nodes(BASIS.domain, size, 'interior')
        values = generator.uniform(size=(size, 2))

        def plain(
            nodes: np.ndarray = nodes, values: np.ndarray = values, size: int = size
        ) -> np.ndarray:
            return np.linalg.solve(collocation_matrix(BASIS, nodes, size - 1), values)

        def accurate(nodes: np.ndarray = nodes, values: np.ndarray = values) -> np.ndarray:
            return solve(factorise(BASIS, nodes), values)

        true = exact.solve(exact.collocation(BASIS, nodes, size - 1), values)
        first, second = best_time(plain), best_time(accurate)
        before = exact.relative_error(plain(), true)
        after = exact.relative_error(accurate(), true)
        print(
            f'{size:4d}            {first * 1e6:8.0f} µs   {before:.0e}'
            f'  {second * 1e6:6.0f} µs   {after:.0e}  {second / first:15.2f}'
        )
    print()
    print('least squares       numpy.linalg.lstsq       HRA (TNQR)           time ratio')
    for rows, columns in ((51, 10), (101, 11), (501, 11), (1001, 14), (1001, 51)):
        nodes = parameter_nodes(BASIS.domain, rows, 'interior')
        values = generator.uniform(size=(rows, 2))

        def plain_fit(
            nodes: np.ndarray = nodes, values: np.ndarray = values, columns: int = columns
        ) -> np.ndarray:
            matrix = collocation_matrix(BASIS, nodes, columns - 1)
            return np.linalg.lstsq(matrix, values, rcond=None)[0]

        def accurate_fit(
            nodes: np.ndarray = nodes, values: np.ndarray = values, columns: int = columns
        ) -> tuple[np.ndarray, np.ndarray]:
            return least_squares(factorise(BASIS, nodes, columns - 1), values)

        first, second = best_time(plain_fit), best_time(accurate_fit)
        print(
            f'{rows:4d} x {columns:2d}       {first * 1e6:8.0f} µs          '
            f'{second * 1e6:8.0f} µs  {second / first:15.2f}'
        )


if __name__ == '__main__':
    main()
