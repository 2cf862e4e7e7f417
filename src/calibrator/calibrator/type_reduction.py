"""Type reduction and defuzzification of interval type-2 systems with crisp consequents.

All functions take lower and upper firing strengths (N, M) and rule outputs F (N, M). A method is
expressed by its effective weights: y = sum_j weights_j F_j, so that least squares can use it.
"""

from __future__ import annotations

import numpy as np

from stage_core.arrays import Array
from stage_core.errors import StageError

SIGN_BAND = 2e-9
"""Outputs closer to the mean than this share of it count as equal to it (sign 0).

Where one rule alone fires, its output equals the mean up to rounding: without a band its sign,
and with it the result, would be noise.
"""

REDUCTIONS = ('maclaurin', 'karnik_mendel', 'nie_tan', 'biglarbegian')


def effective_weights(lower: Array, upper: Array, outputs: Array, reduction: str) -> Array:
    """Weights (N, M) with which a reduction combines the rule outputs of each point.

    ``maclaurin``
        Eqs. 5-10 of paper 1: one sort-free Karnik-Mendel step from the mean under the upper
        (right end) and the lower strengths (left end).
    ``karnik_mendel``
        The same step repeated until the switch points rest: the exact interval, what enhanced
        Karnik-Mendel finds by sorting.
    ``nie_tan``
        Mean of lower and upper strength.
    ``biglarbegian``
        Biglarbegian-Melek-Mendel with equal shares: mean of the two type-1 outputs.
    """
    if reduction == 'nie_tan':
        return _normalised(lower + upper)
    if reduction == 'biglarbegian':
        return 0.5 * (_normalised(lower) + _normalised(upper))
    if reduction not in REDUCTIONS:
        raise StageError(
            f'there is no type reduction {reduction}: choose one of {", ".join(REDUCTIONS)}'
        )
    left, right = end_weights(lower, upper, outputs, reduction == 'karnik_mendel')
    return 0.5 * (left + right)


def end_weights(lower: Array, upper: Array, outputs: Array, exact: bool) -> tuple[Array, Array]:
    """Normalised weights of the left and right end of the interval (eqs. 12 and 18)."""
    left = _step(upper, lower, outputs, np.sum(_normalised(lower) * outputs, axis=1))
    right = _step(lower, upper, outputs, np.sum(_normalised(upper) * outputs, axis=1))
    if exact:
        # Each repetition moves an end outwards by at least one rule: at most M of them.
        for _ in range(outputs.shape[1] + 1):
            new_left = _step(upper, lower, outputs, np.sum(left * outputs, axis=1))
            new_right = _step(lower, upper, outputs, np.sum(right * outputs, axis=1))
            done = np.array_equal(new_left, left) and np.array_equal(new_right, right)
            left, right = new_left, new_right
            if done:
                break
    return left, right


def _step(below: Array, above: Array, outputs: Array, mean: Array) -> Array:
    """Strength `below` for outputs under the mean, `above` over it, their mean on it (sign 0)."""
    difference = outputs - mean[:, None]
    band = SIGN_BAND * np.abs(mean)[:, None]
    chosen = np.where(difference > band, above, np.where(difference < -band, below, 0.0))
    return _normalised(np.where(np.abs(difference) <= band, 0.5 * (above + below), chosen))


def _normalised(strengths: Array) -> Array:
    return strengths / strengths.sum(axis=1, keepdims=True)
