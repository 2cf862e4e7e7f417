"""Compiled loops of the swarm's fitness over one block of samples, all rules in one pass.

They are written for vector registers. `benchmarks/bench_calibrator.py` compares them with a plain
compiled loop.

Rows of a block of samples lie one after the other in flat arrays, row j from j·BLOCK. The numbers
of rules and inputs come as the lengths of tuples, which the compiler knows: it unrolls the loops
over them, keeps a sample's rules in registers, and vectorises over samples. It does so only while
the offsets of rows are constants and indices unsigned (a signed one is tested for counting from
the end). Reassociation lets sums run in vector registers; NaN and infinity keep their meaning,
which full fast-math would take away.

Numba's cache of `swarm_fitness` does not notice a change of this file: touch that one as well.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from calibrator.it2_sets import LOWEST_EXPONENT
from calibrator.type_reduction import SIGN_BAND

Array = NDArray[np.float64]
Tag = tuple[int, ...]

BLOCK = 256
"""Samples per block: the rows of five rules and two inputs fit into the first cache."""

_ROW = np.uint64(BLOCK)
_ONE = np.uint64(1)
_FAST = {'reassoc', 'contract', 'nsz', 'arcp'}
_HALVINGS = 7
_C = tuple(
    np.polynomial.Chebyshev.interpolate(np.exp, 9, [LOWEST_EXPONENT / 2**_HALVINGS, 0.0])
    .convert(kind=np.polynomial.Polynomial)
    .coef.tolist()
)
"""Powers of g in e^g for g from the lowest exponent halved seven times to 0."""


@njit(cache=True, nogil=True, fastmath={'contract'})
def exponential(y: float) -> float:
    """e^y for y in [-60, 0], to 3e-13 of it; vectorises, which the library's does not.

    A polynomial of y / 128, squared seven times; its odd and even powers apart are half the chain
    of dependent operations.
    """
    g = y * (1.0 / 128.0)
    h = g * g
    even = (((_C[8] * h + _C[6]) * h + _C[4]) * h + _C[2]) * h + _C[0]
    odd = (((_C[9] * h + _C[7]) * h + _C[5]) * h + _C[3]) * h + _C[1]
    value = odd * g + even
    for _ in range(_HALVINGS):
        value *= value
    return value


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def exponents(
    rules: Tag, axes: Tag, centres: Array, wide: Array, narrow: Array, pairs: Array, lower: Array,
    upper: Array, strongest: Array, size: Any,
) -> None:  # fmt: skip
    """Exponents of all strengths, and the largest upper one of each sample."""
    for i in range(size):
        best = -np.inf
        for j in range(np.uint64(len(rules))):
            low, high = 0.0, 0.0
            for k in range(np.uint64(len(axes))):
                at = j * np.uint64(len(axes)) + k
                step = pairs[(k + _ONE) * _ROW + i] - centres[at]
                square = step * step
                low -= square * narrow[at]
                high -= square * wide[at]
            lower[j * _ROW + i] = low
            upper[j * _ROW + i] = high
            best = max(best, high)
        strongest[i] = best


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def strengths(rules: Tag, rows: Array, strongest: Array, size: Any) -> None:
    """Exponents to strengths relative to the strongest, with the floor of `it2_sets`."""
    for j in range(np.uint64(len(rules))):
        for i in range(size):
            exponent = max(rows[j * _ROW + i] - strongest[i], LOWEST_EXPONENT)
            rows[j * _ROW + i] = exponential(exponent)


@njit(inline='always')
def _rows(p: int, square: bool) -> tuple[Any, Any]:
    """Where the rows a_j and b_k of product p begin, see `add_products`."""
    j = 0
    if square:
        while p > j:
            j += 1
            p -= j
        return np.uint64(j) * _ROW, np.uint64(p) * _ROW
    return np.uint64(p) * _ROW, np.uint64(0)


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def add_products(a: Array, b: Array, square: bool, pairs: Array, sums: Array, size: Any) -> None:
    """Add the sums of a_j b_k x over a block to sums (P, Q), row x of `pairs` by row.

    Products p are (0,0), (1,0), (1,1), (2,0).. where the result is `square` (b is a then), or else
    those with b's one row. Three rows at a time share what they load: Q is a multiple of three.
    """
    for p in range(len(sums)):
        aj, bk = _rows(p, square)
        for q in range(0, sums.shape[1], 3):
            x = np.uint64(q) * _ROW
            one, two, three = 0.0, 0.0, 0.0
            for i in range(size):
                product = a[aj + i] * b[bk + i]
                one += product * pairs[x + i]
                two += product * pairs[x + _ROW + i]
                three += product * pairs[x + np.uint64(2) * _ROW + i]
            sums[p, q] += one
            sums[p, q + 1] += two
            sums[p, q + 2] += three


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def inverse_sums(rules: Tag, lower: Array, upper: Array, inverses: Array, size: Any) -> None:
    """1 / sum of the lower strengths of each sample, and after BLOCK of them of the upper ones."""
    for i in range(size):
        low, high = 0.0, 0.0
        for j in range(np.uint64(len(rules))):
            low += lower[j * _ROW + i]
            high += upper[j * _ROW + i]
        # One division for two: the slowest operation here.
        inverse = 1.0 / (low * high)
        inverses[i] = inverse * high
        inverses[_ROW + i] = inverse * low


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def plain_weights(
    rules: Tag, code: int, lower: Array, upper: Array, inverses: Array, weights: Array, size: Any
) -> None:
    """Nie-Tan (0) or Biglarbegian-Melek-Mendel (2) weights."""
    for i in range(size):
        by_low, by_high = inverses[i], inverses[_ROW + i]
        if code == 0:
            # 1 / (low + high)
            by_low = by_low * by_high / (by_low + by_high)
            by_high = by_low
        else:
            by_low, by_high = 0.5 * by_low, 0.5 * by_high
        for j in range(np.uint64(len(rules))):
            weights[j * _ROW + i] = lower[j * _ROW + i] * by_low + upper[j * _ROW + i] * by_high


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def plain_error(
    rules: Tag, axes: Tag, weights: Array, pairs: Array, target: Array, theta: Array, size: Any
) -> float:
    """Sum of squared errors of the output with given weights."""
    total = 0.0
    for i in range(size):
        error = -target[i]
        for j in range(np.uint64(len(rules))):
            f = theta[j]
            for k in range(np.uint64(len(axes))):
                f += theta[(k + _ONE) * np.uint64(len(rules)) + j] * pairs[(k + _ONE) * _ROW + i]
            error += weights[j * _ROW + i] * f
        total += error * error
    return total


@njit(inline='always')
def _twice(f: float, least: float, most: float, below: float, above: float) -> float:
    """Twice the strength of a rule at one end: `below` where its output is under the mean.

    The band around the mean, within which both strengths count alike, is `least` to `most`.
    """
    return (above if f > most else below) + (below if f < least else above)


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def signed_error(
    rules: Tag, axes: Tag, lower: Array, upper: Array, inverses: Array, pairs: Array,
    target: Array, theta: Array, weights: Array | None, size: Any,
) -> float:  # fmt: skip
    """Sum of squared errors with the output of eqs. 6-10: one Karnik-Mendel step at each end.

    The weights of that output are written to the first rows of `weights` (2·M·BLOCK), where there
    is such an array; its other rows are scratch. The compiler makes a function for either case.
    """
    total = 0.0
    for i in range(size):
        low_f, high_f = 0.0, 0.0
        for j in range(np.uint64(len(rules))):
            f = theta[j]
            for k in range(np.uint64(len(axes))):
                f += theta[(k + _ONE) * np.uint64(len(rules)) + j] * pairs[(k + _ONE) * _ROW + i]
            low_f += lower[j * _ROW + i] * f
            high_f += upper[j * _ROW + i] * f
        low_f *= inverses[i]
        high_f *= inverses[_ROW + i]
        low_band, high_band = SIGN_BAND * abs(low_f), SIGN_BAND * abs(high_f)
        low_least, low_most = low_f - low_band, low_f + low_band
        high_least, high_most = high_f - high_band, high_f + high_band
        left, right, left_f, right_f = 0.0, 0.0, 0.0, 0.0
        for j in range(np.uint64(len(rules))):
            f = theta[j]
            for k in range(np.uint64(len(axes))):
                f += theta[(k + _ONE) * np.uint64(len(rules)) + j] * pairs[(k + _ONE) * _ROW + i]
            small, large = lower[j * _ROW + i], upper[j * _ROW + i]
            at_left = _twice(f, low_least, low_most, large, small)
            at_right = _twice(f, high_least, high_most, small, large)
            if weights is not None:
                weights[j * _ROW + i] = at_left
                weights[(j + np.uint64(len(rules))) * _ROW + i] = at_right
            left += at_left
            left_f += at_left * f
            right += at_right
            right_f += at_right * f
        inverse = 0.5 / (left * right)
        left *= inverse
        right *= inverse
        error = left_f * right + right_f * left - target[i]
        total += error * error
        if weights is not None:
            for j in range(np.uint64(len(rules))):
                at_right = weights[(j + np.uint64(len(rules))) * _ROW + i]
                weights[j * _ROW + i] = weights[j * _ROW + i] * right + at_right * left
    return total
