"""Compiled fitness of a whole swarm: firing, least squares and type reduction per particle.

A particle's cost is the mean squared error of the interval type-2 system after its consequents
were solved by normal equations with a ridge of 1e-10 of their mean diagonal (inputs and targets
are scaled, so that this regularises only what the rules cannot tell apart). Same readings as
`consequents`, with one sign pass. The final refit of the best particle uses `consequents`.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit
from numpy.typing import NDArray

from calibrator.swarm_loops import (
    BLOCK,
    Tag,
    add_products,
    exponents,
    inverse_sums,
    plain_error,
    plain_weights,
    signed_error,
    strengths,
)

Array = NDArray[np.float64]

RIDGE = 1e-10
REDUCTION_CODES = {'nie_tan': 0, 'maclaurin': 1, 'biglarbegian': 2, 'karnik_mendel': 1}
"""Training with `karnik_mendel` ranks particles by the first step; the refit is exact."""

SHARES = 8
"""Parts of the swarm per thread."""


@njit(cache=True, nogil=True, fastmath={'contract'}, error_model='numpy')
def _factorise(rules: Tag, moments: Array, matrix: Array) -> None:
    """Upper Cholesky factor of the ridge normal equations, its pivots inverted.

    Row by row: the updates run along rows, over adjacent elements.
    """
    count, size = len(rules), len(matrix)
    blocks = size // count
    diagonal = 0.0
    q = 0
    for b in range(blocks):
        for a in range(b, blocks):
            for j in range(count):
                for k in range(count):
                    more, less = max(j, k), min(j, k)
                    value = moments[more * (more + 1) // 2 + less, q]
                    matrix[b * count + j, a * count + k] = value
            q += 1
        for j in range(count):
            diagonal += matrix[b * count + j, b * count + j]
    ridge = RIDGE * diagonal / size + 1e-300
    for i in range(size):
        matrix[i, i] += ridge
    for j in range(size):
        # Rounding can leave a tiny negative pivot for rules that coincide.
        inverse = 1.0 / np.sqrt(max(matrix[j, j], ridge * 1e-3))
        matrix[j, j] = inverse
        for k in range(j + 1, size):
            matrix[j, k] *= inverse
        for i in range(j + 1, size):
            factor = matrix[j, i]
            for k in range(i, size):
                matrix[i, k] -= factor * matrix[j, k]


@njit(cache=True, nogil=True, fastmath={'contract'}, error_model='numpy')
def _solve(matrix: Array, right: Array, theta: Array) -> None:
    """Solution theta ((n+1)·M,), row by row (n+1, M), with the factor of `_factorise`."""
    rules, size = len(right), len(theta)
    blocks = size // rules
    for a in range(blocks):
        for j in range(rules):
            theta[a * rules + j] = right[j, a]
    for j in range(size):
        theta[j] *= matrix[j, j]
        for k in range(j + 1, size):
            theta[k] -= theta[j] * matrix[j, k]
    for i in range(size - 1, -1, -1):
        total = theta[i]
        for k in range(i + 1, size):
            total -= matrix[i, k] * theta[k]
        theta[i] = total * matrix[i, i]


@njit(cache=True, nogil=True)
def swarm_errors(
    rules: Tag,
    axes: Tag,
    particles: Array,
    pairs: Array,
    targets: Array,
    samples: int,
    code: int,
    errors: Array,
) -> None:
    """Sum over the outputs of the mean squared error of each particle.

    Parameters
    ----------
    rules, axes
        Any tuples as long as there are rules and inputs, see `swarm_loops`.
    particles
        (K, 3·M·n), as `AntecedentSets.from_vector` decodes them.
    pairs, targets
        Products x_a x_b of scaled inputs with x_0 = 1 in the order (0,0)..(0,n), (1,1)..
        (blocks, Q·BLOCK), and scaled targets (blocks, outputs, BLOCK).
    samples
        Number of samples; the rest of the last block is not read.
    code
        Of `REDUCTION_CODES`.
    errors
        (K,), written.
    """
    rule_count, terms = len(rules), len(axes) + 1
    outputs = targets.shape[1]
    block_count = len(pairs)
    lower = np.empty(block_count * rule_count * BLOCK).reshape(block_count, -1)
    upper = np.empty(block_count * rule_count * BLOCK).reshape(block_count, -1)
    inverses = np.empty(block_count * 2 * BLOCK).reshape(block_count, -1)
    weights = np.empty(2 * rule_count * BLOCK)
    strongest = np.empty(BLOCK)
    moments = np.empty((rule_count * (rule_count + 1) // 2, len(pairs[0]) // BLOCK))
    right = np.empty((outputs, rule_count, -(-terms // 3) * 3))
    signed_moments = np.empty_like(moments)
    signed_right = np.empty_like(right[0])
    first = np.empty((terms * rule_count, terms * rule_count))
    matrix = np.empty((terms * rule_count, terms * rule_count))
    theta = np.empty(terms * rule_count)
    for p in range(len(particles)):
        errors[p] = 0.0
        moments[:] = 0.0
        right[:] = 0.0
        sets = particles[p].reshape(3, -1)
        wide = np.exp(-2.0 * sets[1])
        narrow = wide * np.exp(-2.0 * np.minimum(sets[2], 0.0))
        for b in range(block_count):
            size = np.uint64(min(BLOCK, samples - b * BLOCK))
            low, up = lower[b], upper[b]
            exponents(rules, axes, sets[0], wide, narrow, pairs[b], low, up, strongest, size)
            strengths(rules, low, strongest, size)
            strengths(rules, up, strongest, size)
            inverse_sums(rules, low, up, inverses[b], size)
            plain_weights(rules, 2 if code == 2 else 0, low, up, inverses[b], weights, size)
            add_products(weights, weights, True, pairs[b], moments, size)
            for o in range(outputs):
                add_products(weights, targets[b, o], False, pairs[b], right[o], size)
        _factorise(rules, moments, first)
        for o in range(outputs):
            _solve(first, right[o], theta)
            best = np.inf
            for attempt in range(2 if code == 1 else 1):
                if attempt == 1:
                    _factorise(rules, signed_moments, matrix)
                    _solve(matrix, signed_right, theta)
                signed_moments[:] = 0.0
                signed_right[:] = 0.0
                total = 0.0
                for b in range(block_count):
                    size = np.uint64(min(BLOCK, samples - b * BLOCK))
                    low, up, x, target = lower[b], upper[b], pairs[b], targets[b, o]
                    inverse = inverses[b]
                    if code == 1 and attempt == 0:
                        total += signed_error(
                            rules, axes, low, up, inverse, x, target, theta, weights, size
                        )
                        add_products(weights, weights, True, x, signed_moments, size)
                        add_products(weights, target, False, x, signed_right, size)
                    elif code == 1:
                        total += signed_error(
                            rules, axes, low, up, inverse, x, target, theta, None, size
                        )
                    else:
                        plain_weights(rules, code, low, up, inverse, weights, size)
                        total += plain_error(rules, axes, weights, x, target, theta, size)
                best = min(best, total / samples)
            errors[p] += best


def input_pairs(inputs: Array) -> Array:
    """Products x_a x_b of inputs (n, N) with x_0 = 1, in the order of `swarm_errors`, (Q, N).

    Rows of zeros make Q a multiple of three.
    """
    extended = np.vstack([np.ones(inputs.shape[1]), inputs])
    first, second = np.triu_indices(len(extended))
    pairs = extended[first] * extended[second]
    return np.vstack([pairs, np.zeros((-len(pairs) % 3, inputs.shape[1]))])


def _blocked(rows: Array) -> Array:
    """Rows (r, N) cut into (blocks, r, BLOCK), the last one padded with zeros."""
    blocks = -(-rows.shape[1] // BLOCK)
    padded = np.zeros((len(rows), blocks * BLOCK))
    padded[:, : rows.shape[1]] = rows
    cut = np.empty(padded.size).reshape(blocks, len(rows), BLOCK)
    cut[:] = padded.reshape(len(rows), blocks, BLOCK).transpose(1, 0, 2)
    return cut


class SwarmFitness:
    """Fitness of a swarm for `pso.minimise`, shared over threads that hold no interpreter lock.

    Parameters
    ----------
    inputs, targets
        (N, n) and (N, outputs), scaled.
    reduction
        Name of the type reduction.
    threads
        Threads over which particles are divided; 0 takes one per processor. The result does
        not depend on it.
    """

    def __init__(self, inputs: Array, targets: Array, reduction: str, threads: int = 0) -> None:
        self._samples = len(inputs)
        self._axes = (0,) * inputs.shape[1]
        pairs = _blocked(input_pairs(inputs.T))
        self._pairs = pairs.reshape(len(pairs), -1)
        self._targets = _blocked(targets.T)
        self._code = REDUCTION_CODES[reduction]
        self._threads = threads or os.cpu_count() or 1

    def __call__(self, particles: Array) -> Array:
        """Errors (K,) of particles (K, d)."""
        errors = np.empty(len(particles))
        if self._threads == 1 or len(particles) == 1:
            self._part(particles, errors, slice(None))
            return errors
        # Small parts: processors are rarely equally fast, and the last one is waited for.
        count = min(SHARES * self._threads, len(particles))
        edges = np.linspace(0, len(particles), count + 1).astype(int)
        parts = [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
        with ThreadPoolExecutor(self._threads) as pool:
            for done in [pool.submit(self._part, particles, errors, part) for part in parts]:
                done.result()
        return errors

    def _part(self, particles: Array, errors: Array, part: slice) -> None:
        swarm_errors(
            (0,) * (particles.shape[1] // (3 * len(self._axes))),
            self._axes,
            np.ascontiguousarray(particles[part]),
            self._pairs,
            self._targets,
            self._samples,
            self._code,
            errors[part],
        )
