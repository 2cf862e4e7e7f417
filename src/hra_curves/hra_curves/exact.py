"""Reference results in 100 decimal digits (mpmath), for the tables and the tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hra_curves.bases import Basis
from stage_core.arrays import Array
from stage_core.errors import StageError

try:
    import mpmath
except ImportError:  # pragma: no cover - a run-time installation without the oracle
    mpmath = None

DIGITS = 100
Table = list[list[Any]]


def _exactly() -> Any:
    """Context in which mpmath counts 100 digits; a :class:`StageError` where it is missing."""
    if mpmath is None:
        raise StageError('the exact results need mpmath: pip install mpmath')
    return mpmath.workdps(DIGITS)


def difference(basis: Basis, upper: float, lower: float) -> Any:
    """f(upper) g(lower) - f(lower) g(upper) of doubles taken as exact, in 100 digits."""
    with _exactly():
        f_upper, g_upper = basis.pair(mpmath.mpf(upper), mpmath)
        f_lower, g_lower = basis.pair(mpmath.mpf(lower), mpmath)
        return f_upper * g_lower - f_lower * g_upper


def collocation(basis: Basis, nodes: ArrayLike, degree: int) -> Table:
    """Collocation matrix of the given doubles, taken as exact, in 100 digits."""
    with _exactly():
        rows = []
        for node in np.asarray(nodes, dtype=float):
            f, g = basis.pair(mpmath.mpf(float(node)), mpmath)
            rows.append(
                [mpmath.binomial(degree, j) * f**j * g ** (degree - j) for j in range(degree + 1)]
            )
        return rows


def solve(matrix: Table, values: Array | Table) -> Table:
    """Solve a square system for the columns of ``values`` (n, m) in 100 digits.

    Elimination without exchange of rows, which a totally positive matrix allows.
    """
    with _exactly():
        work = [
            list(row) + [mpmath.mpf(value) for value in right]
            for row, right in zip(matrix, values, strict=True)
        ]
        size = len(matrix)
        for pivot in range(size):
            top = work[pivot]
            for row in work[pivot + 1 :]:
                factor = row[pivot] / top[pivot]
                if factor:
                    for column in range(pivot + 1, len(top)):
                        row[column] -= factor * top[column]
        result: Table = [[] for _ in range(size)]
        for pivot in range(size - 1, -1, -1):
            row = work[pivot]
            for column in range(size, len(row)):
                known = mpmath.fsum(
                    row[k] * result[k][column - size] for k in range(pivot + 1, size)
                )
                result[pivot].append((row[column] - known) / row[pivot])
        return result


def least_squares(matrix: Table, values: Array) -> Table:
    """Least-squares solution by the normal equations, which 100 digits bear."""
    with _exactly():
        columns = list(zip(*matrix, strict=True))
        right = [[mpmath.mpf(float(value)) for value in column] for column in values.T]
        normal = [[mpmath.fdot(a, b) for b in columns] for a in columns]
        return solve(normal, [[mpmath.fdot(a, b) for b in right] for a in columns])


def relative_error(computed: NDArray[Any], exact: Table) -> float:
    """Relative error in the 2-norm of vectors or tables (n, m), as Table 1 of paper 4."""
    with _exactly():
        numerator = denominator = mpmath.mpf(0)
        for row, reference in zip(np.atleast_2d(computed.T).T, exact, strict=True):
            for value, true in zip(row, reference, strict=True):
                numerator += (mpmath.mpf(float(value)) - true) ** 2
                denominator += true**2
        return float(mpmath.sqrt(numerator / denominator))
