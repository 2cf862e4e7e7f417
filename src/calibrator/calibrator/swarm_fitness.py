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

from calibrator.vector_loops import (
    add_moments,
    add_product,
    add_scaled,
    add_to,
    dot,
    exponentials,
    invert_pair,
    mix,
    multiply,
    shift_floor,
    subtract_squares,
    switch,
)

Array = NDArray[np.float64]

RIDGE = 1e-10
BLOCK = 512
REDUCTION_CODES = {'nie_tan': 0, 'maclaurin': 1, 'biglarbegian': 2, 'karnik_mendel': 1}
"""Training with `karnik_mendel` ranks particles by the first step; the refit is exact."""


@njit(cache=True, nogil=True)
def _firing(particle: Array, x: Array, lower: Array, upper: Array, work: Array, size: int) -> None:
    """Firing strengths (M, size) of one block of samples; see `it2_sets`."""
    rules, count = len(upper), len(x)
    step = rules * count
    strongest = work[0]
    for j in range(rules):
        upper[j, :] = 0.0
        lower[j, :] = 0.0
        for k in range(count):
            at = j * count + k
            wide = np.exp(-2.0 * particle[step + at])
            narrow = wide * np.exp(-2.0 * min(particle[2 * step + at], 0.0))
            subtract_squares(x[k], particle[at], wide, narrow, upper[j], lower[j], size)
        if j == 0:
            strongest[:] = upper[0]
        else:
            np.maximum(strongest, upper[j], strongest)
    for j in range(rules):
        shift_floor(upper[j], strongest, size)
        shift_floor(lower[j], strongest, size)
        exponentials(upper[j], work[1], size)
        exponentials(lower[j], work[1], size)


@njit(cache=True, nogil=True)
def _plain_weights(
    code: int, lower: Array, upper: Array, weights: Array, work: Array, size: int
) -> None:
    """Nie-Tan (0) or Biglarbegian-Melek-Mendel (2) weights, (M, size)."""
    rules = len(upper)
    low, high = work[0], work[1]
    low[:] = 0.0
    high[:] = 0.0
    for j in range(rules):
        add_to(lower[j], low, size)
        add_to(upper[j], high, size)
    if code == 0:
        add_to(low, high, size)
        low[:] = high
    invert_pair(low, high, size)
    factor = 1.0 if code == 0 else 0.5
    for j in range(rules):
        mix(lower[j], low, upper[j], high, factor, weights[j], size)


@njit(cache=True, nogil=True)
def _signed_output(
    lower: Array, upper: Array, outputs: Array, output: Array, work: Array, size: int
) -> None:
    """Output (size,) by eqs. 6-10: one Karnik-Mendel step at each end.

    Leaves the strengths of both ends in rows 8.. of `work` and the inverses of their sums in
    rows 0 and 2, for `_signed_weights`.
    """
    rules = len(upper)
    left, left_f, right, right_f = work[0], work[1], work[2], work[3]
    low, low_f, high, high_f = work[4], work[5], work[6], work[7]
    work[:8] = 0.0
    for j in range(rules):
        add_moments(lower[j], outputs[j], low, low_f, size)
        add_moments(upper[j], outputs[j], high, high_f, size)
    invert_pair(low, high, size)
    multiply(low_f, low, low_f, size)
    multiply(high_f, high, high_f, size)
    for j in range(rules):
        switch(outputs[j], low_f, upper[j], lower[j], work[8 + j], size)
        add_moments(work[8 + j], outputs[j], left, left_f, size)
        switch(outputs[j], high_f, lower[j], upper[j], work[8 + rules + j], size)
        add_moments(work[8 + rules + j], outputs[j], right, right_f, size)
    invert_pair(left, right, size)
    mix(left_f, left, right_f, right, 0.5, output, size)


@njit(cache=True, nogil=True)
def _signed_weights(weights: Array, work: Array, size: int) -> None:
    """Weights (M, size) of the output that `_signed_output` has just found."""
    rules = len(weights)
    for j in range(rules):
        mix(work[8 + j], work[0], work[8 + rules + j], work[2], 0.5, weights[j], size)


@njit(cache=True, nogil=True)
def _add_normal(weights: Array, pairs: Array, gram: Array, product: Array, size: int) -> None:
    """Add a block to the moments gram[j, k, pair] = sum nu_j nu_k x_a x_b, k <= j."""
    for j in range(len(weights)):
        for k in range(j + 1):
            multiply(weights[j], weights[k], product, size)
            for q in range(len(pairs)):
                gram[j, k, q] += dot(product, pairs[q], size)


@njit(cache=True, nogil=True)
def _add_right(
    weights: Array, pairs: Array, target: Array, right: Array, product: Array, size: int
) -> None:
    """Add a block to right[a, j] = sum nu_j x_a t; the first rows of pairs are x_0 = 1 .. x_n."""
    for j in range(len(weights)):
        multiply(weights[j], target, product, size)
        for a in range(len(right)):
            right[a, j] += dot(product, pairs[a], size)


@njit(cache=True, nogil=True)
def _solve(moments: Array, right: Array, matrix: Array, theta: Array) -> None:
    """Cholesky solution theta (n+1, M) of the ridge normal equations."""
    blocks, rules = right.shape
    size = blocks * rules
    diagonal = 0.0
    for a in range(blocks):
        for b in range(a + 1):
            # Pairs are ordered (0,0)..(0,n), (1,1)..(1,n), ...
            q = b * blocks - b * (b - 1) // 2 + (a - b)
            for j in range(rules):
                for k in range(rules):
                    value = moments[max(j, k), min(j, k), q]
                    matrix[a * rules + j, b * rules + k] = value
        for j in range(rules):
            diagonal += matrix[a * rules + j, a * rules + j]
    ridge = RIDGE * diagonal / size + 1e-300
    for i in range(size):
        matrix[i, i] += ridge
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i == j:
                # Rounding can leave a tiny negative pivot for rules that coincide.
                matrix[i, i] = np.sqrt(max(total, ridge * 1e-3))
            else:
                matrix[i, j] = total / matrix[j, j]
    flat = theta.reshape(size)
    flat[:] = right.reshape(size)
    for i in range(size):
        for k in range(i):
            flat[i] -= matrix[i, k] * flat[k]
        flat[i] /= matrix[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            flat[i] -= matrix[k, i] * flat[k]
        flat[i] /= matrix[i, i]


@njit(cache=True, nogil=True)
def _outputs(theta: Array, pairs: Array, outputs: Array, size: int) -> None:
    """Rule outputs F_j of one block, (M, size)."""
    for j in range(len(outputs)):
        outputs[j, :] = theta[0, j]
        for a in range(1, len(theta)):
            add_scaled(theta[a, j], pairs[a], outputs[j], size)


@njit(cache=True, nogil=True)
def _plain_output(weights: Array, outputs: Array, output: Array, size: int) -> None:
    output[:] = 0.0
    for j in range(len(weights)):
        add_product(weights[j], outputs[j], output, size)


@njit(cache=True, nogil=True)
def swarm_errors(
    particles: Array,
    inputs: Array,
    pairs: Array,
    targets: Array,
    samples: int,
    code: int,
    errors: Array,
) -> None:
    """Sum over the outputs of the mean squared error of each particle.

    Parameters
    ----------
    particles
        (K, 3·M·n), as `AntecedentSets.from_vector` decodes them.
    inputs, pairs, targets
        Scaled inputs (blocks, n, BLOCK), their products x_a x_b with x_0 = 1 in the order
        (0,0)..(0,n), (1,1).. (blocks, Q, BLOCK), and scaled targets (blocks, outputs, BLOCK).
    samples
        Number of samples; the rest of the last block is not read.
    code
        Of `REDUCTION_CODES`.
    errors
        (K,), written.
    """
    count = inputs.shape[1]
    rules = particles.shape[1] // (3 * count)
    terms = count + 1
    outputs_count = targets.shape[1]
    block_count = len(inputs)
    lower = np.empty((block_count, rules, BLOCK))
    upper = np.empty((block_count, rules, BLOCK))
    weights = np.empty((rules, BLOCK))
    outputs = np.empty((rules, BLOCK))
    work = np.empty((8 + 2 * rules, BLOCK))
    product = np.empty(BLOCK)
    moments = np.empty((rules, rules, pairs.shape[1]))
    right = np.empty((outputs_count, terms, rules))
    signed_moments = np.empty_like(moments)
    signed_right = np.empty((terms, rules))
    matrix = np.empty((terms * rules, terms * rules))
    theta = np.empty((terms, rules))
    for p in range(len(particles)):
        errors[p] = 0.0
        moments[:] = 0.0
        right[:] = 0.0
        for b in range(block_count):
            size = min(BLOCK, samples - b * BLOCK)
            _firing(particles[p], inputs[b], lower[b], upper[b], work, size)
            _plain_weights(2 if code == 2 else 0, lower[b], upper[b], weights, work, size)
            _add_normal(weights, pairs[b], moments, product, size)
            for o in range(outputs_count):
                _add_right(weights, pairs[b], targets[b, o], right[o], product, size)
        for o in range(outputs_count):
            _solve(moments, right[o], matrix, theta)
            best = np.inf
            for attempt in range(2 if code == 1 else 1):
                if attempt == 1:
                    _solve(signed_moments, signed_right, matrix, theta)
                signed_moments[:] = 0.0
                signed_right[:] = 0.0
                total = 0.0
                for b in range(block_count):
                    size = min(BLOCK, samples - b * BLOCK)
                    _outputs(theta, pairs[b], outputs, size)
                    if code == 1:
                        _signed_output(lower[b], upper[b], outputs, product, work, size)
                    else:
                        _plain_weights(code, lower[b], upper[b], weights, work, size)
                        _plain_output(weights, outputs, product, size)
                    add_scaled(-1.0, targets[b, o], product, size)
                    total += dot(product, product, size)
                    if code == 1 and attempt == 0:
                        _signed_weights(weights, work, size)
                        _add_normal(weights, pairs[b], signed_moments, product, size)
                        _add_right(weights, pairs[b], targets[b, o], signed_right, product, size)
                best = min(best, total / samples)
            errors[p] += best


def input_pairs(inputs: Array) -> Array:
    """Products x_a x_b (Q, N) of inputs (n, N) with x_0 = 1, in the order of `swarm_errors`."""
    extended = np.vstack([np.ones(inputs.shape[1]), inputs])
    return np.array(
        [extended[a] * extended[b] for a in range(len(extended)) for b in range(a, len(extended))]
    )


def _blocked(rows: Array) -> Array:
    """Rows (r, N) cut into (blocks, r, BLOCK), the last one padded with zeros."""
    blocks = -(-rows.shape[1] // BLOCK)
    padded = np.zeros((len(rows), blocks * BLOCK))
    padded[:, : rows.shape[1]] = rows
    return np.ascontiguousarray(padded.reshape(len(rows), blocks, BLOCK).transpose(1, 0, 2))


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
        self._inputs = _blocked(inputs.T)
        self._pairs = _blocked(input_pairs(inputs.T))
        self._targets = _blocked(targets.T)
        self._code = REDUCTION_CODES[reduction]
        self._threads = threads or os.cpu_count() or 1

    def __call__(self, particles: Array) -> Array:
        """Errors (K,) of particles (K, d)."""
        errors = np.empty(len(particles))
        edges = np.linspace(0, len(particles), self._threads + 1).astype(int)
        parts = [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True) if b > a]
        if len(parts) == 1:
            self._part(particles, errors, parts[0])
            return errors
        with ThreadPoolExecutor(len(parts)) as pool:
            for done in [pool.submit(self._part, particles, errors, part) for part in parts]:
                done.result()
        return errors

    def _part(self, particles: Array, errors: Array, part: slice) -> None:
        swarm_errors(
            np.ascontiguousarray(particles[part]),
            self._inputs,
            self._pairs,
            self._targets,
            self._samples,
            self._code,
            errors[part],
        )
