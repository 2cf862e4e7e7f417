"""Compiled kernels of the totally positive algebra; arrays are C-ordered float64.

The bidiagonal factorisation A = F_l .. F_1 D G_1 .. G_n of a (l+1) x (n+1) matrix is kept in one
array of the shape of A, as Eq. 14 of paper 4 lays it out: multipliers m below the diagonal, pivots
on it, multipliers of the transpose above it. With rows from zero, F_k adds ``B[i, i - k]`` times
row i - 1 to row i, and G_k adds ``B[r - k + 1, r + 1]`` times row r + 1 to row r.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stage_core.arrays import Array


@njit(cache=True)
def _product_error(a: float, b: float) -> float:
    """a b minus its rounded product, exactly (Dekker and Veltkamp)."""
    spread = 134217729.0 * a
    a_high = spread - (spread - a)
    a_low = a - a_high
    spread = 134217729.0 * b
    b_high = spread - (spread - b)
    b_low = b - b_high
    return a_low * b_low - (((a * b - a_high * b_high) - a_low * b_high) - a_high * b_low)


@njit(cache=True)
def _quotient_error(a: float, b: float) -> float:
    """Relative error of the rounded quotient a/b: the true one is (a/b) (1 + error)."""
    if a == 0.0:
        return 0.0
    quotient = a / b
    return ((a - quotient * b) - _product_error(quotient, b)) / a


@njit(cache=True)
def fill_factorisation(
    f: Array, g: Array, g_lost: Array, differences: Array, differences_lost: Array, entries: Array
) -> None:
    """Write Eq. 10 of paper 4 into ``entries`` (l+1, n+1).

    ``differences[i, k - 1]`` is f_i g_(i-k) - f_(i-k) g_i, and the true values are
    g (1 + g_lost) and differences (1 + differences_lost). No entry comes from a difference of
    computed numbers. The products are n factors long and share their roundings with the entries
    beside and below, so these would add up over the matrix: they are carried along to first
    order. Products run in the order that keeps each factor near one, and pivots carry their
    exponent apart: at degree 200 the power of g alone would underflow.
    """
    rows, columns = entries.shape
    degree = columns - 1
    for i in range(1, rows):
        quotient = g[i] / g[i - 1]
        lost_in_power = g_lost[i] - g_lost[i - 1] + _quotient_error(g[i], g[i - 1])
        product, lost = 1.0, 0.0
        for j in range(min(i, columns)):
            # A real exponent calls pow, rounded once; an integer one multiplies repeatedly.
            power = quotient ** float(degree - j) * (1.0 + (degree - j) * lost_in_power)
            entries[i, j] = power * (g[i - 1 - j] / g[i - 1]) * (product * (1.0 + lost))
            if j + 1 < i and j < degree:
                above = differences[i - 1, j]
                step = differences[i, j] / above
                lost += _quotient_error(differences[i, j], above)
                lost += differences_lost[i, j] - differences_lost[i - 1, j]
                rounded = product * step
                lost += _product_error(product, step) / rounded
                product = rounded
    for i in range(columns):
        mantissa, exponent = math.frexp(g[i])
        mantissa = mantissa ** float(degree - i) * (1.0 + (degree - i) * g_lost[i])
        exponent *= degree - i
        for k in range(1, i + 1):
            mantissa *= (degree - k + 1) / k * (differences[i, k - 1] / g[i - k])
            mantissa, shift = math.frexp(mantissa)
            exponent += shift
        entries[i, i] = math.ldexp(mantissa, exponent)
        for j in range(i + 1, columns):
            entries[i, j] = (degree - j + 1) / j * (f[i] / g[i])


@njit(cache=True)
def multiply(entries: Array, vectors: Array) -> Array:
    """Product A x for ``vectors`` (n+1, m), returned with shape (l+1, m)."""
    rows, columns = entries.shape
    width = vectors.shape[1]
    result = np.zeros((rows, width))
    result[:columns] = vectors
    for k in range(columns - 1, 0, -1):
        for r in range(k - 1, columns - 1):
            for m in range(width):
                result[r, m] += entries[r - k + 1, r + 1] * result[r + 1, m]
    for i in range(columns):
        for m in range(width):
            result[i, m] *= entries[i, i]
    for k in range(1, rows):
        for i in range(min(rows - 1, k + columns - 1), k - 1, -1):
            for m in range(width):
                result[i, m] += entries[i, i - k] * result[i - 1, m]
    return result


@njit(cache=True)
def solve_upper(entries: Array, vectors: Array) -> None:
    """Solve D G_1 .. G_n x = b in place for the first n+1 rows of ``vectors``."""
    columns = entries.shape[1]
    width = vectors.shape[1]
    for i in range(columns):
        for m in range(width):
            vectors[i, m] /= entries[i, i]
    for k in range(1, columns):
        for r in range(columns - 2, k - 2, -1):
            for m in range(width):
                vectors[r, m] -= entries[r - k + 1, r + 1] * vectors[r + 1, m]


@njit(cache=True)
def solve_square(entries: Array, vectors: Array) -> None:
    """Solve A x = b in place, O(n**2) for each column of ``vectors`` (TNSolve of Koev)."""
    rows = entries.shape[0]
    width = vectors.shape[1]
    for k in range(rows - 1, 0, -1):
        for i in range(k, rows):
            for m in range(width):
                vectors[i, m] -= entries[i, i - k] * vectors[i - 1, m]
    solve_upper(entries, vectors)


@njit(cache=True)
def _merge_upper(entries: Array, first: int, amount: float) -> None:
    """Multiply G_1 .. G_n from the left by I + amount e_first e_(first+1)^T."""
    columns = entries.shape[1]
    r = first
    k = 1
    while amount > 0.0:
        own = entries[r - k + 1, r + 1]
        total = own + amount
        entries[r - k + 1, r + 1] = total
        if r + 2 > columns - 1:
            return
        # The braid relation of neighbouring elementary matrices; every term is positive.
        following = entries[r - k + 2, r + 2]
        entries[r - k + 2, r + 2] = following * (own / total)
        amount = following * (amount / total)
        r += 1
        k += 1


@njit(cache=True)
def rotate_to_upper(entries: Array, cosines: Array, sines: Array) -> None:
    """Turn ``entries`` into the factorisation of R in A = Q R (TNQR of Koev), in place.

    The rotation that clears position (i, j) is the multiplier itself, t = s/c. What remains of
    it is a positive multiple of row i added to row i - 1 and a scaling of both rows; both are
    carried through the bidiagonal factors without a subtraction. Costs O(l n**2).
    ``cosines`` and ``sines`` (l+1, n+1) receive the rotations.
    """
    rows, columns = entries.shape
    for j in range(columns):
        for i in range(rows - 1, j, -1):
            tangent = entries[i, j]
            hypotenuse = math.sqrt(1.0 + tangent * tangent)
            cosine = 1.0 / hypotenuse
            sine = tangent / hypotenuse
            cosines[i, j] = cosine
            sines[i, j] = sine
            entries[i, j] = 0.0
            above, own, amount = hypotenuse, cosine, sine * cosine
            if i + 1 < rows and j + 1 < columns:
                entries[i + 1, j + 1] /= own
            for k in range(i - j - 1, 0, -1):
                if i - 1 - k < columns:
                    entries[i - 1, i - 1 - k] *= above
                if i - k < columns:
                    factor = 1.0 + amount * entries[i, i - k]
                    entries[i, i - k] *= own / (above * factor)
                    above *= factor
                    own /= factor
                    amount /= factor
                if i + 1 < rows and i + 1 - k < columns:
                    entries[i + 1, i + 1 - k] /= own
            if i < columns:
                amount *= entries[i, i] / entries[i - 1, i - 1]
                entries[i, i] *= own
            if i - 1 < columns:
                entries[i - 1, i - 1] *= above
            if i < columns:
                _merge_upper(entries, i - 1, amount)


@njit(cache=True)
def rotate_vectors(cosines: Array, sines: Array, vectors: Array) -> None:
    """Apply Q^T to ``vectors`` (l+1, m) in place, in the order of the elimination."""
    rows, columns = cosines.shape
    for j in range(columns):
        for i in range(rows - 1, j, -1):
            cosine, sine = cosines[i, j], sines[i, j]
            for m in range(vectors.shape[1]):
                upper, lower = vectors[i - 1, m], vectors[i, m]
                vectors[i - 1, m] = cosine * upper + sine * lower
                vectors[i, m] = cosine * lower - sine * upper


@njit(cache=True)
def evaluate_series(control: Array, f: Array, g: Array, result: Array) -> None:
    """Evaluate sum_j C(n,j) f**j g**(n-j) c_j with derivatives, by corner cutting.

    The recursion b_j <- g b_j + f b_(j+1) of de Casteljau, on truncated Taylor series in the
    parameter: only products and sums with f, g >= 0, O(n**2) a point.

    Parameters
    ----------
    control : (n+1, d). f, g : Taylor coefficients (m, order+1).
    result : (m, order+1, d), receives the Taylor coefficients of the curve.
    """
    count, dimension = control.shape
    terms = f.shape[1]
    work = np.empty((count, terms, dimension))
    for p in range(f.shape[0]):
        for j in range(count):
            for d in range(dimension):
                work[j, 0, d] = control[j, d]
                for o in range(1, terms):
                    work[j, o, d] = 0.0
        for level in range(count - 1, 0, -1):
            for j in range(level):
                # Highest order first: an order needs only the lower ones of the level before.
                for o in range(terms - 1, -1, -1):
                    for d in range(dimension):
                        total = 0.0
                        for q in range(o + 1):
                            total += g[p, q] * work[j, o - q, d] + f[p, q] * work[j + 1, o - q, d]
                        work[j, o, d] = total
        for o in range(terms):
            for d in range(dimension):
                result[p, o, d] = work[0, o, d]
