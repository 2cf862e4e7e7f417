"""Compiled fitness of a whole swarm: firing, least squares and type reduction per particle.

A particle's cost is the mean squared error of the interval type-2 system after its consequents
were solved by normal equations with a ridge of 1e-10 of their mean diagonal (inputs and targets
are scaled, so that this regularises only what the rules cannot tell apart). Same readings as
`consequents`, with one sign pass. The final refit of the best particle uses `consequents`.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

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


class Room(NamedTuple):
    """Arrays that the particles of a part share one after the other.

    Strengths of the rules and inverses of their sums, a row per block of samples; then normal
    equations of the plain weights and of the signed ones, and what solving them takes.
    """

    lower: Array
    upper: Array
    inverses: Array
    weights: Array
    strongest: Array
    moments: Array
    right: Array
    signed_moments: Array
    signed_right: Array
    first: Array
    matrix: Array
    theta: Array


@njit(cache=True, nogil=True)
def _room(rules: Tag, axes: Tag, pairs: Array, targets: Array) -> Room:
    count, terms, outputs, blocks = len(rules), len(axes) + 1, targets.shape[1], len(pairs)
    moments = np.empty((count * (count + 1) // 2, len(pairs[0]) // BLOCK))
    right = np.empty((outputs, count, -(-terms // 3) * 3))
    return Room(
        np.empty(blocks * count * BLOCK).reshape(blocks, -1),
        np.empty(blocks * count * BLOCK).reshape(blocks, -1),
        np.empty(blocks * 2 * BLOCK).reshape(blocks, -1),
        np.empty(2 * count * BLOCK),
        np.empty(BLOCK),
        moments,
        right,
        np.empty_like(moments),
        np.empty_like(right[0]),
        np.empty((terms * count, terms * count)),
        np.empty((terms * count, terms * count)),
        np.empty(terms * count),
    )


@njit(cache=True, nogil=True)
def _fire(
    rules: Tag,
    axes: Tag,
    particle: Array,
    pairs: Array,
    targets: Array,
    samples: int,
    code: int,
    room: Room,
) -> None:
    """Strengths of a particle's rules at every sample, and the plain normal equations."""
    room.moments[:] = 0.0
    room.right[:] = 0.0
    sets = particle.reshape(3, -1)
    wide = np.exp(-2.0 * sets[1])
    narrow = wide * np.exp(-2.0 * np.minimum(sets[2], 0.0))
    strongest, weights = room.strongest, room.weights
    for b in range(len(pairs)):
        size = np.uint64(min(BLOCK, samples - b * BLOCK))
        low, up, inverse = room.lower[b], room.upper[b], room.inverses[b]
        exponents(rules, axes, sets[0], wide, narrow, pairs[b], low, up, strongest, size)
        strengths(rules, low, strongest, size)
        strengths(rules, up, strongest, size)
        inverse_sums(rules, low, up, inverse, size)
        plain_weights(rules, 2 if code == 2 else 0, low, up, inverse, weights, size)
        add_products(weights, weights, True, pairs[b], room.moments, size)
        for o in range(targets.shape[1]):
            add_products(weights, targets[b, o], False, pairs[b], room.right[o], size)


@njit(cache=True, nogil=True)
def _squares(
    rules: Tag,
    axes: Tag,
    output: int,
    pairs: Array,
    targets: Array,
    samples: int,
    code: int,
    again: bool,
    room: Room,
) -> float:
    """Sum of the squared errors of one output with the consequents `theta` of the room.

    With signed weights their normal equations are summed on the way, unless they are what
    `theta` comes from already (`again`).
    """
    theta, weights = room.theta, room.weights
    room.signed_moments[:] = 0.0
    room.signed_right[:] = 0.0
    total = 0.0
    for b in range(len(pairs)):
        size = np.uint64(min(BLOCK, samples - b * BLOCK))
        low, up, inverse = room.lower[b], room.upper[b], room.inverses[b]
        x, target = pairs[b], targets[b, output]
        if code != 1:
            plain_weights(rules, code, low, up, inverse, weights, size)
            total += plain_error(rules, axes, weights, x, target, theta, size)
        elif again:
            total += signed_error(rules, axes, low, up, inverse, x, target, theta, None, size)
        else:
            total += signed_error(rules, axes, low, up, inverse, x, target, theta, weights, size)
            add_products(weights, weights, True, x, room.signed_moments, size)
            add_products(weights, target, False, x, room.signed_right, size)
    return total


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
    room = _room(rules, axes, pairs, targets)
    for p in range(len(particles)):
        _fire(rules, axes, particles[p], pairs, targets, samples, code, room)
        _factorise(rules, room.moments, room.first)
        errors[p] = 0.0
        for o in range(targets.shape[1]):
            _solve(room.first, room.right[o], room.theta)
            best = _squares(rules, axes, o, pairs, targets, samples, code, False, room)
            if code == 1:
                _factorise(rules, room.signed_moments, room.matrix)
                _solve(room.matrix, room.signed_right, room.theta)
                second = _squares(rules, axes, o, pairs, targets, samples, code, True, room)
                best = min(best, second)
            errors[p] += best / samples


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
