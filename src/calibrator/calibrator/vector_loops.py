"""Small loops over one block of samples, written so that the compiler vectorises them.

Each writes one or two arrays: with more, the compiler's limit on overlap checks leaves a loop
scalar. Reassociation lets sums run in vector registers; NaN and infinity keep their meaning,
which full fast-math would take away. `size` is the number of entries to work on.

Numba's cache of `swarm_fitness` does not notice a change of this file: touch that one as well.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from calibrator.it2_sets import LOWEST_EXPONENT
from calibrator.type_reduction import SIGN_BAND

Array = NDArray[np.float64]

_FAST = {'reassoc', 'contract', 'nsz', 'arcp'}
_MAGIC = 1.5 * 2.0**52
_MAGIC_BITS = np.int64(np.array([_MAGIC]).view(np.int64)[0])


@njit(cache=True, nogil=True)
def exponentials(values: Array, scratch: Array, size: int) -> None:
    """exp of the first `size` values, in [-700, 0], in place to 3e-14; `scratch` is as long.

    Vectorises, which the library's exponential does not: 2^n from the bits of a float whose
    fraction holds n, times a polynomial of the rest. No fast-math here: it would cancel the
    addition and subtraction of the magic number.
    """
    bits = scratch.view(np.int64)
    for i in range(size):
        scratch[i] = values[i] * 1.4426950408889634 + _MAGIC
    for i in range(size):
        n = scratch[i] - _MAGIC
        g = values[i] - n * 0.6931471805599453
        p = 1.0 + g * (1.0 / 11.0)
        p = 1.0 + g * (1.0 / 9.0) * (1.0 + g * 0.1 * p)
        p = 1.0 + g * (1.0 / 7.0) * (1.0 + g * 0.125 * p)
        p = 1.0 + g * 0.2 * (1.0 + g * (1.0 / 6.0) * p)
        p = 1.0 + g * (1.0 / 3.0) * (1.0 + g * 0.25 * p)
        values[i] = 1.0 + g * (1.0 + g * 0.5 * p)
    for i in range(size):
        bits[i] = (bits[i] - _MAGIC_BITS + 1023) << 52
    for i in range(size):
        values[i] *= scratch[i]


@njit(cache=True, nogil=True, fastmath=_FAST)
def subtract_squares(
    x: Array, centre: float, wide: float, narrow: float, upper: Array, lower: Array, size: int
) -> None:
    """Subtract (x - centre)^2 times a factor from each exponent."""
    for i in range(size):
        square = (x[i] - centre) * (x[i] - centre)
        upper[i] -= square * wide
        lower[i] -= square * narrow


@njit(cache=True, nogil=True, fastmath=_FAST)
def shift_floor(exponent: Array, strongest: Array, size: int) -> None:
    """Divide by the strongest strength, with the floor of `it2_sets`."""
    for i in range(size):
        exponent[i] = max(exponent[i] - strongest[i], LOWEST_EXPONENT)


@njit(cache=True, nogil=True, fastmath=_FAST)
def dot(a: Array, b: Array, size: int) -> float:
    """Sum of products."""
    total = 0.0
    for i in range(size):
        total += a[i] * b[i]
    return total


@njit(cache=True, nogil=True, fastmath=_FAST)
def multiply(a: Array, b: Array, out: Array, size: int) -> None:
    """out = a b."""
    for i in range(size):
        out[i] = a[i] * b[i]


@njit(cache=True, nogil=True, fastmath=_FAST)
def add_product(a: Array, b: Array, out: Array, size: int) -> None:
    """out += a b."""
    for i in range(size):
        out[i] += a[i] * b[i]


@njit(cache=True, nogil=True, fastmath=_FAST)
def add_to(a: Array, out: Array, size: int) -> None:
    """out += a."""
    for i in range(size):
        out[i] += a[i]


@njit(cache=True, nogil=True, fastmath=_FAST)
def add_scaled(factor: float, a: Array, out: Array, size: int) -> None:
    """out += factor a."""
    for i in range(size):
        out[i] += factor * a[i]


@njit(cache=True, nogil=True, fastmath=_FAST)
def invert_pair(a: Array, b: Array, size: int) -> None:
    """Replace two rows by their inverses with one division, the slowest operation here."""
    for i in range(size):
        inverse = 1.0 / (a[i] * b[i])
        by_a = inverse * b[i]
        b[i] = inverse * a[i]
        a[i] = by_a


@njit(cache=True, nogil=True, fastmath=_FAST)
def add_moments(strength: Array, f: Array, total: Array, first: Array, size: int) -> None:
    """total += strength, first += strength f."""
    for i in range(size):
        total[i] += strength[i]
        first[i] += strength[i] * f[i]


@njit(cache=True, nogil=True, fastmath=_FAST)
def switch(f: Array, mean: Array, below: Array, above: Array, out: Array, size: int) -> None:
    """Twice the strength of eqs. 6 and 8: `above` for f over the mean, `below` for f under it."""
    for i in range(size):
        # Without branches: s = sign(f - mean), (below + above) + s (above - below).
        over = f[i] - mean[i]
        band = SIGN_BAND * (abs(f[i]) + abs(mean[i]))
        sign = (1.0 if over > band else 0.0) - (1.0 if over < -band else 0.0)
        out[i] = below[i] + above[i] + sign * (above[i] - below[i])


@njit(cache=True, nogil=True, fastmath=_FAST)
def mix(a: Array, by_a: Array, b: Array, by_b: Array, factor: float, out: Array, n: int) -> None:
    """out = factor (a by_a + b by_b)."""
    for i in range(n):
        out[i] = factor * (a[i] * by_a[i] + b[i] * by_b[i])
