"""Bidiagonal factorisation of fg-Bernstein collocation matrices in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hra_curves import kernels
from hra_curves.bases import Basis
from stage_core.arrays import Array
from stage_core.errors import StageError

MAXIMUM_DEGREE = 1000


@dataclass(frozen=True)
class Bidiagonal:
    """A totally positive matrix of shape (l+1, n+1), l >= n, as its bidiagonal factors.

    ``entries`` follows Eq. 14 of paper 4: multipliers below the diagonal, pivots on it,
    multipliers of the transpose above it; all are nonnegative.
    """

    entries: Array

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of the matrix."""
        return self.entries.shape[0], self.entries.shape[1]

    def multiply(self, vectors: ArrayLike) -> Array:
        """Product of the matrix and ``vectors`` (n+1,) or (n+1, m)."""
        values = np.asarray(vectors, dtype=float)
        columns = values.reshape(values.shape[0], -1)
        product = kernels.multiply(self.entries, np.ascontiguousarray(columns))
        return product.reshape((self.shape[0],) + values.shape[1:])


def check_nodes(basis: Basis, nodes: ArrayLike) -> Array:
    """Return the nodes as a float array if the factorisation exists for them.

    Raises
    ------
    StageError
        Nodes not finite, none at all, repeated, not increasing, or outside the domain.
    """
    values = np.ascontiguousarray(nodes, dtype=float)
    if values.ndim != 1:
        raise StageError(f'nodes of shape {values.shape}: give one increasing list of numbers')
    if values.size < 1:
        raise StageError('0 nodes are too few: give at least 1')
    if not np.isfinite(values).all():
        index = int(np.flatnonzero(~np.isfinite(values))[0])
        raise StageError(f'node {index} is {values[index]}: remove what is not a finite number')
    steps = np.diff(values)
    if (steps <= 0).any():
        index = int(np.flatnonzero(steps <= 0)[0])
        what = 'repeats' if steps[index] == 0 else 'is smaller than'
        raise StageError(
            f'node {index + 1} ({values[index + 1]}) {what} node {index}: '
            'sort the nodes and merge equal ones'
        )
    lower, upper = basis.domain
    if values[0] < lower or values[-1] > upper:
        raise StageError(
            f'nodes from {values[0]} to {values[-1]} leave the domain [{lower}, {upper}]: '
            'scale them or choose another domain'
        )
    return values


def factorise(basis: Basis, nodes: ArrayLike, degree: int | None = None) -> Bidiagonal:
    """Bidiagonal factorisation of the collocation matrix, Eq. 10 of paper 4 (TNBDA).

    Parameters
    ----------
    basis : pair (f, g).
    nodes : l+1 increasing parameters in the closed domain.
    degree : n <= l; None takes l, the square matrix of interpolation.

    Returns
    -------
    Bidiagonal
        Factors of the (l+1) x (n+1) matrix C(n,j) f(t_i)**j g(t_i)**(n-j); each entry has a
        relative error of a small multiple of n times the unit round-off.

    Raises
    ------
    StageError
        Bad nodes, a degree without enough nodes, or pivots beyond the range of a double.
    """
    values = check_nodes(basis, nodes)
    rows = values.size
    columns = rows if degree is None else degree + 1
    if columns < 1 or columns > rows:
        raise StageError(
            f'degree {degree} needs at least {columns} nodes and {rows} are given: '
            'add nodes or lower the degree (from 0)'
        )
    if columns - 1 > MAXIMUM_DEGREE:
        raise StageError(f'degree {columns - 1} exceeds {MAXIMUM_DEGREE}: split the curve')
    f, g = (np.ascontiguousarray(part, dtype=float) for part in basis.pair(values))
    differences = np.zeros((rows, max(columns - 1, 1)))
    differences_lost = np.zeros_like(differences)
    for k in range(1, columns):
        upper, lower = values[k:], values[:-k]
        differences[k:, k - 1] = basis.differences(upper, lower)
        differences_lost[k:, k - 1] = basis.differences_lost(upper, lower)
    entries = np.zeros((rows, columns))
    kernels.fill_factorisation(f, g, basis.g_lost(values), differences, differences_lost, entries)
    pivots = np.diagonal(entries)
    if not np.isfinite(entries).all() or pivots.min() < np.finfo(float).tiny:
        raise StageError(
            f'the pivots at degree {columns - 1} leave the range of double precision: '
            'spread the nodes, scale the domain or lower the degree'
        )
    return Bidiagonal(entries)


def collocation_matrix(basis: Basis, nodes: ArrayLike, degree: int) -> Array:
    """Collocation matrix of Eq. 8 itself, (l+1, n+1): what a plain solver starts from."""
    f, g = basis.pair(check_nodes(basis, nodes))
    powers = np.arange(degree + 1)
    binomials = np.cumprod(np.concatenate(([1.0], (degree - powers[1:] + 1) / powers[1:])))
    return binomials * f[:, None] ** powers * g[:, None] ** (degree - powers)
