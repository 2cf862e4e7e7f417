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
_MAGIC = 1.5 * 2.0**52
_MAGIC_BITS = np.int64(np.array([_MAGIC]).view(np.int64)[0])


@njit(cache=True, nogil=True, fastmath={'contract'})
def exponentials(values: Array, scratch: Array, size: Any) -> None:
    """exp of the first `size` values, in [-700, 0], in place to 3e-14; `scratch` is as long.

    Vectorises, which the library's exponential does not: 2^n from the bits of a float whose
    fraction holds n, times a polynomial of the rest. No reassociation here: it would cancel the
    addition and subtraction of the magic number.
    """
    bits = scratch.view(np.int64)
    for i in range(size):
        scratch[i] = values[i] * 1.4426950408889634 + _MAGIC
    for i in range(size):
        n = scratch[i] - _MAGIC
        g = values[i] - n * 0.6931471805599453
        p = 1.0 / 39916800.0
        p = p * g + 1.0 / 3628800.0
        p = p * g + 1.0 / 362880.0
        p = p * g + 1.0 / 40320.0
        p = p * g + 1.0 / 5040.0
        p = p * g + 1.0 / 720.0
        p = p * g + 1.0 / 120.0
        p = p * g + 1.0 / 24.0
        p = p * g + 1.0 / 6.0
        p = p * g + 1.0 / 2.0
        values[i] = (p * g + 1.0) * g + 1.0
    for i in range(size):
        bits[i] = (bits[i] - _MAGIC_BITS + 1023) << 52
    for i in range(size):
        values[i] *= scratch[i]


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def strongest_exponent(
    rules: Tag, axes: Tag, centres: Array, wide: Array, pairs: Array, out: Array, size: Any
) -> None:
    """Largest exponent of the upper strengths of each sample."""
    for i in range(size):
        best = -np.inf
        for j in range(np.uint64(len(rules))):
            total = 0.0
            for k in range(np.uint64(len(axes))):
                at = j * np.uint64(len(axes)) + k
                step = pairs[(k + _ONE) * _ROW + i] - centres[at]
                total -= step * step * wide[at]
            best = max(best, total)
        out[i] = best


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def exponent(
    axes: Tag, centres: Array, factors: Array, pairs: Array, strongest: Array, out: Array,
    size: Any,
) -> None:  # fmt: skip
    """Exponent of one rule's strength relative to the strongest, with the floor of `it2_sets`."""
    for i in range(size):
        total = -strongest[i]
        for k in range(np.uint64(len(axes))):
            step = pairs[(k + _ONE) * _ROW + i] - centres[k]
            total -= step * step * factors[k]
        out[i] = max(total, LOWEST_EXPONENT)


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def three_sums(a: Array, at: Any, b: Array, bt: Any, pairs: Array, q: Any, size: Any) -> Any:
    """Sums of a b x over three rows of pairs from offset q; a and b from their offsets."""
    first, second, third = 0.0, 0.0, 0.0
    for i in range(size):
        product = a[at + i] * b[bt + i]
        first += product * pairs[q + i]
        second += product * pairs[q + _ROW + i]
        third += product * pairs[q + _ROW + _ROW + i]
    return first, second, third


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def one_sum(a: Array, at: Any, b: Array, bt: Any, pairs: Array, q: Any, size: Any) -> float:
    """Sum of a b x over one row of pairs."""
    total = 0.0
    for i in range(size):
        total += a[at + i] * b[bt + i] * pairs[q + i]
    return total


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
    """Twice the strength of a rule at one end: `below` where its output is under the mean."""
    over, band = f - mean, SIGN_BAND * (abs(f) + abs(mean))
    return (above if over > band else below) + (below if over < -band else above)


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def signed_error(
    rules: Tag, axes: Tag, lower: Array, upper: Array, pairs: Array, target: Array, theta: Array,
    size: Any,
) -> float:  # fmt: skip
    """Sum of squared errors with the output of eqs. 6-10: one Karnik-Mendel step at each end."""
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
            left += at_left
            left_f += at_left * f
            right += at_right
            right_f += at_right * f
        error = 0.5 * (left_f * right + right_f * left) / (left * right) - target[i]
        total += error * error
    return total


@njit(cache=True, nogil=True, fastmath=_FAST, error_model='numpy')
def signed_weights(
    rules: Tag, axes: Tag, lower: Array, upper: Array, pairs: Array, target: Array, theta: Array,
    weights: Array, size: Any,
) -> float:  # fmt: skip
    """`signed_error`, and the weights of that output."""
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
            left += at_left
            left_f += at_left * f
            right += at_right
            right_f += at_right * f
        inverse = 0.5 / (left * right)
        error = inverse * (left_f * right + right_f * left) - target[i]
        total += error * error
        for j in range(np.uint64(len(rules))):
            f = theta[j]
            for k in range(np.uint64(len(axes))):
                f += theta[(k + _ONE) * np.uint64(len(rules)) + j] * pairs[(k + _ONE) * _ROW + i]
            small, large = lower[j * _ROW + i], upper[j * _ROW + i]
            at_left = _twice(f, low_f, large, small)
            at_right = _twice(f, high_f, small, large)
            weights[j * _ROW + i] = inverse * (at_left * right + at_right * left)
    return total
