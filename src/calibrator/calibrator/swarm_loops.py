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


@intrinsic
def _wide(context: Any) -> Any:
    """Ask for the widest vectors in the function that calls this.

    Where a processor has registers of 512 bits, the compiler keeps to 256 by itself. llvmlite has
    no name for the attribute, so its check of names is passed by; others ignore it.
    """
    del context

    def code(context: Any, builder: Any, _: Any, given: Any) -> Any:
        del given
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.none(), code


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
    _wide()
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
    _wide()
    for j in range(np.uint64(len(rules))):
        for i in range(size):
            rows[j * _ROW + i] = exp2(max(rows[j * _ROW + i] - strongest[i], _LOWEST))


@njit(inline='always')
def _add_to(sums: Array, values: tuple[float, ...]) -> None:
    for i in range(len(values)):
        sums[i] += values[i]


@njit(inline='always')
def _rows(p: int, square: bool) -> tuple[Any, Any]:
    """Where the rows a_j and b_k of product p begin, see `add_six`."""
    j = 0
    if square:
        while p > j:
            j += 1
            p -= j
        return np.uint64(j) * _ROW, np.uint64(p) * _ROW
    return np.uint64(p) * _ROW, np.uint64(0)


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def add_six(
    a: Array, b: Array, square: bool, pairs: Array, q: Any, sums: Array, size: Any
) -> None:
    """Add the sums of a_j b_k x over rows q .. q + 5 of pairs to sums[p, q:] (P, Q).

    Products p are (0,0), (1,0), (1,1), (2,0).. where the result is `square` (b is a then), or else
    those with b's one row. Two at a time share what they load; of an odd number the last one goes
    with itself and counts once. The loop over products is in here because a call costs what 20
    samples do.
    """
    _wide()
    x = np.uint64(q) * _ROW
    for p in range(0, len(sums), 2):
        both = p + 1 < len(sums)
        aj, bk = _rows(p, square)
        am, bn = _rows(p + 1 if both else p, square)
        a0, a1, a2, a3, a4, a5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        b0, b1, b2, b3, b4, b5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(size):
            one, two = a[aj + i] * b[bk + i], a[am + i] * b[bn + i]
            a0 += one * pairs[x + i]
            a1 += one * pairs[x + _ROW + i]
            a2 += one * pairs[x + np.uint64(2) * _ROW + i]
            a3 += one * pairs[x + np.uint64(3) * _ROW + i]
            a4 += one * pairs[x + np.uint64(4) * _ROW + i]
            a5 += one * pairs[x + np.uint64(5) * _ROW + i]
            b0 += two * pairs[x + i]
            b1 += two * pairs[x + _ROW + i]
            b2 += two * pairs[x + np.uint64(2) * _ROW + i]
            b3 += two * pairs[x + np.uint64(3) * _ROW + i]
            b4 += two * pairs[x + np.uint64(4) * _ROW + i]
            b5 += two * pairs[x + np.uint64(5) * _ROW + i]
        _add_to(sums[p, q : q + 6], (a0, a1, a2, a3, a4, a5))
        if both:
            _add_to(sums[p + 1, q : q + 6], (b0, b1, b2, b3, b4, b5))


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def add_three(
    a: Array, b: Array, square: bool, pairs: Array, q: Any, sums: Array, size: Any
) -> None:
    """`add_six` for three rows."""
    _wide()
    x = np.uint64(q) * _ROW
    for p in range(0, len(sums), 2):
        both = p + 1 < len(sums)
        aj, bk = _rows(p, square)
        am, bn = _rows(p + 1 if both else p, square)
        a0, a1, a2, b0, b1, b2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(size):
            one, two = a[aj + i] * b[bk + i], a[am + i] * b[bn + i]
            a0 += one * pairs[x + i]
            a1 += one * pairs[x + _ROW + i]
            a2 += one * pairs[x + np.uint64(2) * _ROW + i]
            b0 += two * pairs[x + i]
            b1 += two * pairs[x + _ROW + i]
            b2 += two * pairs[x + np.uint64(2) * _ROW + i]
        _add_to(sums[p, q : q + 3], (a0, a1, a2))
        if both:
            _add_to(sums[p + 1, q : q + 3], (b0, b1, b2))


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def add_one(
    a: Array, b: Array, square: bool, pairs: Array, q: Any, sums: Array, size: Any
) -> None:
    """`add_six` for one row."""
    _wide()
    x = np.uint64(q) * _ROW
    for p in range(len(sums)):
        aj, bk = _rows(p, square)
        total = 0.0
        for i in range(size):
            total += a[aj + i] * b[bk + i] * pairs[x + i]
        sums[p, q] += total


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def inverse_sums(rules: Tag, lower: Array, upper: Array, inverses: Array, size: Any) -> None:
    """1 / sum of the lower strengths of each sample, and after BLOCK of them of the upper ones."""
    _wide()
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
    _wide()
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
    _wide()
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
    _wide()
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
