"""Compiled fitness of a whole swarm: firing, least squares and type reduction per particle.

A particle's cost is the mean squared error of the interval type-2 system after its consequents
were solved by normal equations with a ridge of 1e-10 of their mean diagonal (inputs and targets
are scaled, so that this regularises only what the rules cannot tell apart). Same readings as
`consequents`, with one sign pass. The final refit of the best particle uses `consequents`.

The loops are written for vector registers: plain ones took 1.9 to 2.3 times as long for
`maclaurin` (docs/results/calibration.md#speed). Rows of a block of samples lie one after the other
in flat arrays, row j from j·BLOCK. The numbers of rules and inputs come as the lengths of tuples,
which the compiler knows: it unrolls the loops over them, keeps a sample's rules in registers, and
vectorises over samples. It does so only while the offsets of rows are constants and indices
unsigned (a signed one is tested for counting from the end). Reassociation lets sums run in vector
registers; NaN and infinity keep their meaning, which full fast-math would take away.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numba import njit

from calibrator.it2_sets import LOWEST_EXPONENT
from calibrator.type_reduction import SIGN_BAND
from stage_core.arrays import Array

Tag = tuple[int, ...]
Firing = tuple[Array, Array, Array, Array]

RIDGE = 1e-10
REDUCTION_CODES = {'nie_tan': 0, 'maclaurin': 1, 'biglarbegian': 2, 'karnik_mendel': 1}
"""Training with `karnik_mendel` ranks particles by the first step; the refit is exact."""

SHARES = 8
"""Parts of the swarm per thread."""

BLOCK = 256
"""Samples per block: the rows of five rules and two inputs fit into the first cache."""

_ROW = np.uint64(BLOCK)
_ONE = np.uint64(1)
_HALVINGS = 7
_C = tuple(
    np.polynomial.Chebyshev.interpolate(np.exp, 9, [LOWEST_EXPONENT / 2**_HALVINGS, 0.0])
    .convert(kind=np.polynomial.Polynomial)
    .coef.tolist()
)
"""Powers of g in e^g for g from the lowest exponent halved seven times to 0."""

_compiled = njit(
    cache=True, nogil=True, fastmath={'reassoc', 'contract', 'nsz', 'arcp'}, error_model='numpy'
)


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


@_compiled
def _fire(
    rules: Tag, axes: Tag, sets: Array, pairs: Array, lower: Array, upper: Array, inverses: Array
) -> None:  # fmt: skip
    """Strengths of the rules relative to the strongest, with the floor of `it2_sets`.

    And 1 / sum of the lower ones of each sample, then after BLOCK of them that of the upper ones.
    """
    for i in range(_ROW):
        strongest = -np.inf
        for j in range(np.uint64(len(rules))):
            low, high = 0.0, 0.0
            for k in range(np.uint64(len(axes))):
                at = j * np.uint64(len(axes)) + k
                step = pairs[(k + _ONE) * _ROW + i] - sets[0, at]
                square = step * step
                low -= square * sets[2, at]
                high -= square * sets[1, at]
            lower[j * _ROW + i] = low
            upper[j * _ROW + i] = high
            strongest = max(strongest, high)
        inverses[i] = strongest
    for rows in (lower, upper):
        for j in range(np.uint64(len(rules))):
            for i in range(_ROW):
                exponent = max(rows[j * _ROW + i] - inverses[i], LOWEST_EXPONENT)
                rows[j * _ROW + i] = exponential(exponent)
    for i in range(_ROW):
        low, high = 0.0, 0.0
        for j in range(np.uint64(len(rules))):
            low += lower[j * _ROW + i]
            high += upper[j * _ROW + i]
        # One division for two: the slowest operation here.
        inverse = 1.0 / (low * high)
        inverses[i] = inverse * high
        inverses[_ROW + i] = inverse * low


@_compiled
def _add_products(rules: Tag, a: Array, b: Array, square: bool, pairs: Array, sums: Array) -> None:
    """Add the sums of a_j b_k x over a block to sums (P, Q), row x of `pairs` by row.

    Products are (0,0), (1,0), (1,1), (2,0).. where the result is `square` (b is a then), or else
    those with b's one row. Three rows at a time share what they load: Q is a multiple of three.
    """
    p = 0
    for j in range(np.uint64(len(rules))):
        for k in range(j + _ONE if square else _ONE):
            for q in range(0, sums.shape[1], 3):
                x = np.uint64(q) * _ROW
                one, two, three = 0.0, 0.0, 0.0
                for i in range(_ROW):
                    product = a[j * _ROW + i] * b[k * _ROW + i]
                    one += product * pairs[x + i]
                    two += product * pairs[x + _ROW + i]
                    three += product * pairs[x + np.uint64(2) * _ROW + i]
                sums[p, q] += one
                sums[p, q + 1] += two
                sums[p, q + 2] += three
            p += 1


@_compiled
def _mean_weights(
    rules: Tag, code: int, lower: Array, upper: Array, inverses: Array, weights: Array
) -> None:
    """Weights that do not ask for outputs: Biglarbegian-Melek-Mendel's (2), else Nie-Tan's."""
    for i in range(_ROW):
        by_low, by_high = inverses[i], inverses[_ROW + i]
        if code == 2:
            by_low, by_high = 0.5 * by_low, 0.5 * by_high
        else:
            # Both are 1 / (low + high).
            by_low = by_high = by_low * by_high / (by_low + by_high)
        for j in range(np.uint64(len(rules))):
            weights[j * _ROW + i] = lower[j * _ROW + i] * by_low + upper[j * _ROW + i] * by_high


@njit(inline='always')
def _output(rules: Tag, axes: Tag, pairs: Array, theta: Array, j: Any, i: Any) -> float:
    """Output of rule j at sample i."""
    f = 0.0
    for k in range(np.uint64(len(axes)) + _ONE):
        f += theta[k * np.uint64(len(rules)) + j] * pairs[k * _ROW + i]
    return f


@njit(inline='always')
def _twice(f: float, mean: float, below: float, above: float) -> float:
    """Twice the strength of a rule at one end: `below` where its output is under the mean.

    In a band around the mean both strengths count alike.
    """
    band = SIGN_BAND * abs(mean)
    return (above if f > mean + band else below) + (below if f < mean - band else above)


@_compiled
def _signed_weights(
    rules: Tag, axes: Tag, lower: Array, upper: Array, inverses: Array, pairs: Array,
    theta: Array, weights: Array,
) -> None:  # fmt: skip
    """Weights of eqs. 6-10, first rows of `weights` (2·M·BLOCK); its other rows are scratch."""
    for i in range(_ROW):
        low_f, high_f = 0.0, 0.0
        for j in range(np.uint64(len(rules))):
            f = _output(rules, axes, pairs, theta, j, i)
            low_f += lower[j * _ROW + i] * f
            high_f += upper[j * _ROW + i] * f
        low_f *= inverses[i]
        high_f *= inverses[_ROW + i]
        left, right = 0.0, 0.0
        for j in range(np.uint64(len(rules))):
            f = _output(rules, axes, pairs, theta, j, i)
            small, large = lower[j * _ROW + i], upper[j * _ROW + i]
            at_left = _twice(f, low_f, large, small)
            at_right = _twice(f, high_f, small, large)
            weights[j * _ROW + i] = at_left
            weights[(j + np.uint64(len(rules))) * _ROW + i] = at_right
            left += at_left
            right += at_right
        inverse = 0.5 / (left * right)
        left *= inverse
        right *= inverse
        for j in range(np.uint64(len(rules))):
            at_right = weights[(j + np.uint64(len(rules))) * _ROW + i]
            weights[j * _ROW + i] = weights[j * _ROW + i] * right + at_right * left


@_compiled
def _squares(
    rules: Tag, axes: Tag, weights: Array, pairs: Array, target: Array, theta: Array
) -> float:
    """Sum of the squared errors of one output with given weights and consequents."""
    total = 0.0
    for i in range(_ROW):
        error = -target[i]
        for j in range(np.uint64(len(rules))):
            error += weights[j * _ROW + i] * _output(rules, axes, pairs, theta, j, i)
        total += error * error
    return total


@njit(cache=True, nogil=True)
def solve(moments: Array, right: Array, theta: Array) -> None:
    """Consequents theta ((n+1)·M,) that solve the ridge normal equations.

    `moments` (M·(M+1)/2, Q) and `right` (M, Q) are sums of `_add_products`.
    """
    count, size = len(right), len(theta)
    matrix = np.empty((size, size))
    q = 0
    for b in range(0, size, count):
        for a in range(b, size, count):
            for j in range(count):
                for k in range(count):
                    more, less = max(j, k), min(j, k)
                    matrix[b + j, a + k] = moments[more * (more + 1) // 2 + less, q]
                    matrix[a + k, b + j] = matrix[b + j, a + k]
            q += 1
        for j in range(count):
            theta[b + j] = right[j, b // count]
    ridge = RIDGE * np.trace(matrix) / size + 1e-300
    for i in range(size):
        matrix[i, i] += ridge
    theta[:] = np.linalg.solve(matrix, theta)


@njit(cache=True, nogil=True)
def _least_squares(
    rules: Tag, axes: Tag, firing: Firing, pairs: Array, target: Array, signed: bool,
    moments: Array, right: Array,
) -> float:  # fmt: skip
    """Sum of one output's squared errors, with signs the smaller one of two solutions.

    The first one's normal equations are given; those of its signed weights are summed on the way.
    """
    lower, upper, inverses, weights = firing
    theta = np.empty((len(axes) + 1) * len(rules))
    solve(moments, right, theta)
    best = np.inf
    for step in range(2 if signed else 1):
        signed_moments, signed_right = np.zeros_like(moments), np.zeros_like(right)
        total = 0.0
        for b in range(len(pairs)):
            x, w = pairs[b], weights[b]
            if signed:
                _signed_weights(rules, axes, lower[b], upper[b], inverses[b], x, theta, w)
            total += _squares(rules, axes, w, x, target[b], theta)
            if signed and step == 0:
                _add_products(rules, w, w, True, x, signed_moments)
                _add_products(rules, w, target[b], False, x, signed_right)
        best = min(best, total)
        if signed and step == 0:
            solve(signed_moments, signed_right, theta)
    return best


@njit(cache=True, nogil=True)
def swarm_errors(
    rules: Tag, axes: Tag, particles: Array, pairs: Array, targets: Array, code: int
) -> Array:
    """Sum of the squared errors of each particle, (K,).

    `rules` and `axes` are any tuples of their numbers; particles (K, 3·M·n) as
    `AntecedentSets.from_vector` decodes them; pairs (blocks, Q·BLOCK) and targets (outputs,
    blocks, BLOCK) as `blocked` cuts them; `code` of `REDUCTION_CODES`.
    """
    count, outputs, blocks = len(rules), len(targets), len(pairs)
    lower, weights = np.empty((blocks, count * BLOCK)), np.empty((blocks, 2 * count * BLOCK))
    upper, inverses = np.empty_like(lower), np.empty((blocks, 2 * BLOCK))
    firing, errors = (lower, upper, inverses, weights), np.zeros(len(particles))
    for p in range(len(particles)):
        sets = particles[p].copy().reshape(3, -1)
        sets[1] = np.exp(-2.0 * sets[1])
        sets[2] = sets[1] * np.exp(-2.0 * np.minimum(sets[2], 0.0))
        moments = np.zeros((count * (count + 1) // 2, pairs.shape[1] // BLOCK))
        right = np.zeros((outputs, count, -(-(len(axes) + 1) // 3) * 3))
        for b in range(blocks):
            x, w = pairs[b], weights[b]
            _fire(rules, axes, sets, x, lower[b], upper[b], inverses[b])
            _mean_weights(rules, code, lower[b], upper[b], inverses[b], w)
            _add_products(rules, w, w, True, x, moments)
            for o in range(outputs):
                _add_products(rules, w, targets[o, b], False, x, right[o])
        for o in range(outputs):
            errors[p] += _least_squares(
                rules, axes, firing, pairs, targets[o], code == 1, moments, right[o]
            )
    return errors


def input_pairs(inputs: Array) -> Array:
    """Products x_a x_b of inputs (N, n) with x_0 = 1 in the order (0,0)..(0,n), (1,1).., (Q, N).

    Rows of zeros make Q a multiple of three.
    """
    extended = np.vstack([np.ones(len(inputs)), inputs.T])
    first, second = np.triu_indices(len(extended))
    return np.pad(extended[first] * extended[second], ((0, -len(first) % 3), (0, 0)))


def blocked(rows: Array) -> Array:
    """Rows (r, N) cut into blocks (r, blocks, BLOCK), the last one filled up with zeros."""
    padded = np.pad(rows, ((0, 0), (0, -rows.shape[1] % BLOCK)))
    return np.ascontiguousarray(padded).reshape(len(rows), -1, BLOCK)


class SwarmFitness:
    """Fitness of a swarm for `pso.minimise`, shared over threads that hold no interpreter lock.

    Inputs (N, n) and targets (N, outputs) are scaled. `threads` 0 takes one per processor; the
    result does not depend on it.
    """

    def __init__(self, inputs: Array, targets: Array, reduction: str, threads: int = 0) -> None:
        self._axes = (0,) * inputs.shape[1]
        pairs = np.ascontiguousarray(blocked(input_pairs(inputs)).swapaxes(0, 1))
        self._data = pairs.reshape(len(pairs), -1), blocked(targets.T), REDUCTION_CODES[reduction]
        self._samples = len(inputs)
        self._threads = threads or os.cpu_count() or 1

    def __call__(self, particles: Array) -> Array:
        """Errors (K,) of particles (K, d)."""
        rules = (0,) * (particles.shape[1] // (3 * len(self._axes)))
        # Small parts: processors are rarely equally fast, and the last one is waited for.
        count = min(SHARES * self._threads, len(particles))
        parts = np.array_split(np.ascontiguousarray(particles), count)
        with ThreadPoolExecutor(self._threads) as pool:
            errors = pool.map(
                lambda part: swarm_errors(rules, self._axes, part, *self._data), parts
            )
            return np.concatenate(list(errors)) / self._samples
