"""Linear algebra on a bidiagonal factorisation: what Koev's TNSolve and TNQR do, and more."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hra_curves import kernels
from hra_curves.factorisation import Bidiagonal
from stage_core.arrays import Array
from stage_core.errors import StageError


def _right_hand_side(matrix: Bidiagonal, values: ArrayLike) -> Array:
    data = np.array(values, dtype=float)
    if data.ndim not in (1, 2) or data.shape[0] != matrix.shape[0]:
        raise StageError(
            f'data of shape {data.shape} for {matrix.shape[0]} nodes: give one row for each node'
        )
    if not np.isfinite(data).all():
        row = int(np.argwhere(~np.isfinite(data))[0][0])
        raise StageError(f'data row {row} is not finite: remove the point and its node')
    return np.ascontiguousarray(data.reshape(data.shape[0], -1))


def _need_square(matrix: Bidiagonal) -> None:
    rows, columns = matrix.shape
    if rows != columns:
        raise StageError(
            f'the matrix is {rows} x {columns}, not square: use least_squares, or as many '
            'control points as nodes'
        )


def solve(matrix: Bidiagonal, values: ArrayLike) -> Array:
    """Solve A x = b in O(n**2) (TNSolve).

    For ``values`` of alternating signs each component of the result has high relative accuracy;
    for others the error is that of the inverse in high relative accuracy, |A^-1| |b| u.

    Parameters
    ----------
    matrix : square factorisation. values : (n+1,) or (n+1, m).
    """
    _need_square(matrix)
    result = _right_hand_side(matrix, values)
    kernels.solve_square(matrix.entries, result)
    return result.reshape(np.shape(values))


def inverse(matrix: Bidiagonal) -> Array:
    """Inverse, each entry to high relative accuracy.

    A column of the identity keeps its signs alternating through every factor, so nothing
    cancels.
    """
    return solve(matrix, np.eye(matrix.shape[0]))


def determinant(matrix: Bidiagonal) -> tuple[float, float]:
    """Determinant and its natural logarithm; the first may underflow where the second holds."""
    _need_square(matrix)
    pivots = np.diagonal(matrix.entries)
    mantissa, exponent = 1.0, 0
    for pivot in pivots:
        mantissa, shift = math.frexp(mantissa * float(pivot))
        exponent += shift
    return math.ldexp(mantissa, exponent), math.log(mantissa) + exponent * math.log(2.0)


@dataclass(frozen=True)
class OrthogonalFactors:
    """A = Q R with Q as rotations and R as bidiagonal factors (TNQR).

    R is totally positive with a positive diagonal; its factors and the rotations have high
    relative accuracy.
    """

    upper: Bidiagonal
    cosines: Array
    sines: Array


def orthogonal_factors(matrix: Bidiagonal) -> OrthogonalFactors:
    """QR factorisation of a totally positive matrix from its bidiagonal factors, O(l n**2)."""
    entries = matrix.entries.copy()
    cosines, sines = np.ones(matrix.shape), np.zeros(matrix.shape)
    kernels.rotate_to_upper(entries, cosines, sines)
    return OrthogonalFactors(Bidiagonal(entries), cosines, sines)


def least_squares(matrix: Bidiagonal, values: ArrayLike) -> tuple[Array, Array]:
    """Minimise |A c - p| by TNQR, Section 4.3 of paper 4.

    Parameters
    ----------
    matrix : factorisation (l+1, n+1). values : (l+1,) or (l+1, m).

    Returns
    -------
    coefficients : (n+1,) or (n+1, m).
    residual_norms : () or (m,), the root of the sum of squares of each column.
    """
    factors = orthogonal_factors(matrix)
    rotated = _right_hand_side(matrix, values)
    kernels.rotate_vectors(factors.cosines, factors.sines, rotated)
    columns = matrix.shape[1]
    norms = np.sqrt((rotated[columns:] ** 2).sum(axis=0))
    coefficients = np.ascontiguousarray(rotated[:columns])
    kernels.solve_upper(factors.upper.entries, coefficients)
    tail = np.shape(values)[1:]
    return coefficients.reshape((columns,) + tail), norms.reshape(tail)
