"""Fitness of a swarm in plain compiled loops: what `calibrator.swarm_fitness` is measured against.

The same equations for `nie_tan` and `maclaurin`, one short loop along a row of samples after the
other, which the compiler vectorises by itself. Nothing is allocated for a sample; the exponential
and the solution of the normal equations are those of the calibrator.
"""

import numpy as np
from numba import njit

from calibrator.it2_sets import LOWEST_EXPONENT
from calibrator.swarm_fitness import blocked, exponential, input_pairs, solve
from calibrator.type_reduction import SIGN_BAND

Array = np.ndarray
_compiled = njit(nogil=True, fastmath={'reassoc', 'contract', 'nsz', 'arcp'}, error_model='numpy')


@_compiled
def fire(sets: Array, x: Array, lower: Array, upper: Array, inverses: Array) -> None:
    """Strengths (rules, n) relative to the strongest rule, and 1 / their sums (2, n)."""
    strongest, samples = inverses[0], x.shape[1]
    strongest[:] = -np.inf
    lower[:] = 0.0
    upper[:] = 0.0
    for j in range(len(lower)):
        for k in range(sets.shape[2]):
            for i in range(samples):
                square = (x[k + 1, i] - sets[0, j, k]) ** 2
                lower[j, i] -= square * sets[2, j, k]
                upper[j, i] -= square * sets[1, j, k]
        for i in range(samples):
            strongest[i] = max(strongest[i], upper[j, i])
    for rows in (lower, upper):
        for j in range(len(rows)):
            for i in range(samples):
                rows[j, i] = exponential(max(rows[j, i] - strongest[i], LOWEST_EXPONENT))
    for end, rows in enumerate((lower, upper)):
        inverses[end] = 0.0
        for j in range(len(rows)):
            for i in range(samples):
                inverses[end, i] += rows[j, i]
        for i in range(samples):
            inverses[end, i] = 1.0 / inverses[end, i]


@_compiled
def mean_weights(lower: Array, upper: Array, inverses: Array, weights: Array) -> None:
    """Nie-Tan weights (rules, n)."""
    for j in range(len(lower)):
        for i in range(lower.shape[1]):
            low, high = inverses[0, i], inverses[1, i]
            weights[j, i] = (lower[j, i] + upper[j, i]) * (low * high / (low + high))


@_compiled
def one_end(
    f: Array, strengths: Array, inverse: Array, below: Array, above: Array, weights: Array,
    room: Array,
) -> None:  # fmt: skip
    """A Karnik-Mendel step at one end; `room` gets the mean and the sums of the weights."""
    room[:] = 0.0
    for j in range(len(f)):
        for i in range(f.shape[1]):
            room[0, i] += strengths[j, i] * f[j, i]
    for i in range(f.shape[1]):
        room[0, i] *= inverse[i]
    for j in range(len(f)):
        for i in range(f.shape[1]):
            out, low, high, mean = f[j, i], below[j, i], above[j, i], room[0, i]
            band = SIGN_BAND * abs(mean)
            weight = high if out > mean + band else low
            weights[j, i] = weight + (low if out < mean - band else high)
        for i in range(f.shape[1]):
            room[1, i] += weights[j, i]


@_compiled
def end_weights(
    lower: Array, upper: Array, inverses: Array, f: Array, weights: Array, right: Array,
    room: Array,
) -> None:  # fmt: skip
    """Weights (rules, n) of both ends of the interval for outputs f; the rest is scratch."""
    one_end(f, lower, inverses[0], upper, lower, weights, room[:2])
    one_end(f, upper, inverses[1], lower, upper, right, room[2:])
    for i in range(f.shape[1]):
        room[1, i] = 0.5 / room[1, i]
        room[3, i] = 0.5 / room[3, i]
    for j in range(len(f)):
        for i in range(f.shape[1]):
            weights[j, i] = weights[j, i] * room[1, i] + right[j, i] * room[3, i]


@_compiled
def add_products(a: Array, b: Array, rows: Array, sums: Array) -> None:
    """Add the sums of a b x to sums (Q,), row x by row, three of which share what they load."""
    for q in range(0, len(sums), 3):
        one, two, three = 0.0, 0.0, 0.0
        for i in range(len(a)):
            product = a[i] * b[i]
            one += product * rows[q, i]
            two += product * rows[q + 1, i]
            three += product * rows[q + 2, i]
        sums[q] += one
        sums[q + 1] += two
        sums[q + 2] += three


@_compiled
def add_moments(w: Array, targets: Array, pairs: Array, moments: Array, right: Array) -> None:
    """Add to the sums of the normal equations of some outputs."""
    p = 0
    for j in range(len(w)):
        for k in range(j + 1):
            add_products(w[j], w[k], pairs, moments[p])
            p += 1
        for o in range(len(targets)):
            add_products(w[j], targets[o], pairs, right[o, j])


@_compiled
def rule_outputs(theta: Array, x: Array, f: Array) -> None:
    """Outputs (rules, n) for consequents theta ((n+1)·rules,)."""
    rules = len(f)
    f[:] = 0.0
    for j in range(rules):
        for k in range(len(theta) // rules):
            for i in range(f.shape[1]):
                f[j, i] += theta[k * rules + j] * x[k, i]


@_compiled
def squares(weights: Array, f: Array, target: Array, error: Array) -> float:
    """Sum of the squared errors of one output."""
    for i in range(len(error)):
        error[i] = -target[i]
    for j in range(len(f)):
        for i in range(len(error)):
            error[i] += weights[j, i] * f[j, i]
    total = 0.0
    for i in range(len(error)):
        total += error[i] ** 2
    return total


@_compiled
def plain_errors(
    particles: Array, rules: int, pairs: Array, targets: Array, signed: bool, errors: Array
) -> None:
    """Sums of squared errors (K,), for blocks of pairs and of targets (blocks, rows, n)."""
    axes, outputs = particles.shape[1] // (3 * rules), targets.shape[1]
    blocks, q, n = pairs.shape
    lower, upper = np.empty((blocks, rules, n)), np.empty((blocks, rules, n))
    inverses, room = np.empty((blocks, 2, n)), np.empty((4, n))
    weights, scratch, f = np.empty((blocks, rules, n)), np.empty((rules, n)), np.empty((rules, n))
    moments, right = np.empty((rules * (rules + 1) // 2, q)), np.empty((outputs, rules, q))
    theta = np.empty((axes + 1) * rules)
    again, signed_moments = np.empty((1, rules, q)), np.empty_like(moments)
    for p in range(len(particles)):
        sets = particles[p].copy().reshape(3, rules, axes)
        sets[1] = np.exp(-2.0 * sets[1])
        sets[2] = sets[1] * np.exp(-2.0 * np.minimum(sets[2], 0.0))
        moments[:] = 0.0
        right[:] = 0.0
        for b in range(blocks):
            fire(sets, pairs[b], lower[b], upper[b], inverses[b])
            mean_weights(lower[b], upper[b], inverses[b], weights[b])
            add_moments(weights[b], targets[b], pairs[b], moments, right)
        errors[p] = 0.0
        for o in range(outputs):
            solve(moments, right[o], theta)
            best = np.inf
            for step in range(2 if signed else 1):
                total = 0.0
                signed_moments[:] = 0.0
                again[:] = 0.0
                for b in range(blocks):
                    target = targets[b, o : o + 1]
                    rule_outputs(theta, pairs[b], f)
                    if signed:
                        end_weights(lower[b], upper[b], inverses[b], f, weights[b], scratch, room)
                    total += squares(weights[b], f, target[0], room[0])
                    if signed and step == 0:
                        add_moments(weights[b], target, pairs[b], signed_moments, again)
                best = min(best, total)
                if signed and step == 0:
                    solve(signed_moments, again[0], theta)
            errors[p] += best


class PlainFitness:
    """As `SwarmFitness` on one thread, for a number of rules that is given."""

    def __init__(self, inputs: Array, targets: Array, reduction: str, rules: int) -> None:
        self._pairs, self._targets = (
            np.ascontiguousarray(blocked(rows).swapaxes(0, 1))
            for rows in (input_pairs(inputs), targets.T)
        )
        self._samples, self._rules, self._signed = len(inputs), rules, reduction == 'maclaurin'

    def __call__(self, particles: Array) -> Array:
        """Errors (K,) of particles (K, d)."""
        errors = np.empty(len(particles))
        plain_errors(particles, self._rules, self._pairs, self._targets, self._signed, errors)
        return errors / self._samples
