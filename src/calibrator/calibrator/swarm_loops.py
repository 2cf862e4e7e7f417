"""Compiled loops of the swarm's fitness over one block of samples, all rules in one pass.

Rows lie one after the other in flat arrays, row j from j·BLOCK. The numbers of rules and inputs
come as the lengths of tuples, which the compiler knows: it unrolls the loops over them, keeps a
sample's rules in registers, and vectorises over samples. It does so only while the offsets of
rows are constants and indices unsigned (a signed one is tested for counting from the end).
Reassociation lets sums run in vector registers; NaN and infinity keep their meaning, which full
fast-math would take away.

Numba's cache of `swarm_fitness` does not notice a change of this file: touch that one as well.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic
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
_MAGIC = 1.5 * 2.0**52
_MAGIC_BITS = np.int64(np.array([_MAGIC]).view(np.int64)[0])
_LOWEST = LOWEST_EXPONENT / np.log(2.0)
_C = tuple(
    np.polynomial.Chebyshev.interpolate(np.exp2, 9, [-0.5, 0.5])
    .convert(kind=np.polynomial.Polynomial)
    .coef.tolist()
)
"""Powers of g in 2^g for |g| <= 1/2, to 2e-14 of it."""


@intrinsic
def _bits(context: Any, value: Any) -> Any:
    """The 64 bits of a float as an integer; NumPy's view needs an array, and a loop of its own."""
    del context, value
    return types.int64(types.float64), lambda _, builder, __, given: builder.bitcast(
        given[0], ir.IntType(64)
    )


@intrinsic
def _float(context: Any, value: Any) -> Any:
    """The float that an integer holds the bits of."""
    del context, value
    return types.float64(types.int64), lambda _, builder, __, given: builder.bitcast(
        given[0], ir.DoubleType()
    )


@njit(cache=True, nogil=True, fastmath={'contract'})
def exp2(y: float) -> float:
    """2^y for y in [-1000, 0], to 2e-14 of it; vectorises, which the library's does not.

    2^n from the bits of a float whose fraction holds n, times a polynomial of the rest, odd and
    even powers apart: half the chain of dependent operations. No reassociation here: it would
    cancel the addition and subtraction of the magic number.
    """
    shifted = y + _MAGIC
    g = y - (shifted - _MAGIC)
    h = g * g
    even = (((_C[8] * h + _C[6]) * h + _C[4]) * h + _C[2]) * h + _C[0]
    odd = (((_C[9] * h + _C[7]) * h + _C[5]) * h + _C[3]) * h + _C[1]
    return (odd * g + even) * _float((_bits(shifted) - _MAGIC_BITS + 1023) << 52)


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
    """Base-2 exponents to strengths relative to the strongest, with the floor of `it2_sets`."""
    for j in range(np.uint64(len(rules))):
        for i in range(size):
            rows[j * _ROW + i] = exp2(max(rows[j * _ROW + i] - strongest[i], _LOWEST))


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def add_six(
    rules: Tag, a: Array, b: Array, square: bool, pairs: Array, q: Any, sums: Array, size: Any
) -> None:
    """Add the sums of a_j b_k x over rows q .. q + 5 of pairs to sums[j, k, q:].

    For all rows j of a, and of b the rows k <= j where the result is `square` (b is a then) or
    else its one row. The loops over rows are in here because a call costs what 20 samples do.
    """
    at = np.uint64(q) * _ROW
    for j in range(len(rules)):
        for k in range(j + 1 if square else 1):
            aj, bk = np.uint64(j) * _ROW, np.uint64(k) * _ROW
            first, second, third, fourth, fifth, sixth = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(size):
                product = a[aj + i] * b[bk + i]
                first += product * pairs[at + i]
                second += product * pairs[at + _ROW + i]
                third += product * pairs[at + np.uint64(2) * _ROW + i]
                fourth += product * pairs[at + np.uint64(3) * _ROW + i]
                fifth += product * pairs[at + np.uint64(4) * _ROW + i]
                sixth += product * pairs[at + np.uint64(5) * _ROW + i]
            sums[j, k, q] += first
            sums[j, k, q + 1] += second
            sums[j, k, q + 2] += third
            sums[j, k, q + 3] += fourth
            sums[j, k, q + 4] += fifth
            sums[j, k, q + 5] += sixth


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def add_three(
    rules: Tag, a: Array, b: Array, square: bool, pairs: Array, q: Any, sums: Array, size: Any
) -> None:
    """`add_six` for three rows."""
    at = np.uint64(q) * _ROW
    for j in range(len(rules)):
        for k in range(j + 1 if square else 1):
            aj, bk = np.uint64(j) * _ROW, np.uint64(k) * _ROW
            first, second, third = 0.0, 0.0, 0.0
            for i in range(size):
                product = a[aj + i] * b[bk + i]
                first += product * pairs[at + i]
                second += product * pairs[at + _ROW + i]
                third += product * pairs[at + np.uint64(2) * _ROW + i]
            sums[j, k, q] += first
            sums[j, k, q + 1] += second
            sums[j, k, q + 2] += third


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def add_one(
    rules: Tag, a: Array, b: Array, square: bool, pairs: Array, q: Any, sums: Array, size: Any
) -> None:
    """`add_six` for one row."""
    at = np.uint64(q) * _ROW
    for j in range(len(rules)):
        for k in range(j + 1 if square else 1):
            aj, bk = np.uint64(j) * _ROW, np.uint64(k) * _ROW
            total = 0.0
            for i in range(size):
                total += a[aj + i] * b[bk + i] * pairs[at + i]
            sums[j, k, q] += total


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def plain_weights(
    rules: Tag, code: int, lower: Array, upper: Array, weights: Array, size: Any
) -> None:
    """Nie-Tan (0) or Biglarbegian-Melek-Mendel (2) weights."""
    for i in range(size):
        low, high = 0.0, 0.0
        for j in range(np.uint64(len(rules))):
            low += lower[j * _ROW + i]
            high += upper[j * _ROW + i]
        if code == 0:
            by_low = 1.0 / (low + high)
            by_high = by_low
        else:
            inverse = 0.5 / (low * high)
            by_low, by_high = inverse * high, inverse * low
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
def _twice(f: float, mean: float, below: float, above: float) -> float:
    """Twice the strength of a rule at one end: `below` where its output is under the mean.

    |f - mean| against the band of both, with each number on a side of its own: the compiler
    shares f's over both ends and the mean's over all rules.
    """
    near_f, near_mean = SIGN_BAND * abs(f), SIGN_BAND * abs(mean)
    over, under = f - near_f > mean + near_mean, f + near_f < mean - near_mean
    return (above if over else below) + (below if under else above)


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def signed_error(
    rules: Tag, axes: Tag, lower: Array, upper: Array, pairs: Array, target: Array, theta: Array,
    weights: Array | None, size: Any,
) -> float:  # fmt: skip
    """Sum of squared errors with the output of eqs. 6-10: one Karnik-Mendel step at each end.

    The weights of that output are written to the first rows of `weights` (2·M·BLOCK), where there
    is such an array; its other rows are scratch. The compiler makes a function for either case.
    """
    total = 0.0
    for i in range(size):
        low, high, low_f, high_f = 0.0, 0.0, 0.0, 0.0
        for j in range(np.uint64(len(rules))):
            f = theta[j]
            for k in range(np.uint64(len(axes))):
                f += theta[(k + _ONE) * np.uint64(len(rules)) + j] * pairs[(k + _ONE) * _ROW + i]
            low += lower[j * _ROW + i]
            high += upper[j * _ROW + i]
            low_f += lower[j * _ROW + i] * f
            high_f += upper[j * _ROW + i] * f
        # One division for two: the slowest operation here.
        inverse = 1.0 / (low * high)
        low_f *= inverse * high
        high_f *= inverse * low
        left, right, left_f, right_f = 0.0, 0.0, 0.0, 0.0
        for j in range(np.uint64(len(rules))):
            f = theta[j]
            for k in range(np.uint64(len(axes))):
                f += theta[(k + _ONE) * np.uint64(len(rules)) + j] * pairs[(k + _ONE) * _ROW + i]
            small, large = lower[j * _ROW + i], upper[j * _ROW + i]
            at_left = _twice(f, low_f, large, small)
            at_right = _twice(f, high_f, small, large)
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
