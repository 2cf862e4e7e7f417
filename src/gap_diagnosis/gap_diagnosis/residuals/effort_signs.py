"""Signs of an effort that is recorded as a magnitude."""

from __future__ import annotations

import math

import numpy as np

from gap_diagnosis.input.data import Record
from gap_diagnosis.residuals.control_law import force_increments, velocity_law
from stage_core.arrays import Array
from stage_core.twin_file import ServoAxis

ROUNDS = 3  # of signs and unit in turn


def signs_of(record: Record, i: int, axis: ServoAxis, effort: Array) -> Array:
    """Sign (n,) of the force of which an effort is the magnitude.

    Of the two signs of each tick those whose increments follow the law best (Viterbi, IEEE Trans.
    Information Theory 13, 1967).
    """
    law = force_increments(record, i, axis, velocity_law(record, i, axis))
    size = np.abs(effort)
    # In most ticks the sign stays.
    unit = math.sqrt(float(law @ law) / max(float(np.sum(np.diff(size) ** 2)), 1e-300))
    for _ in range(ROUNDS):
        signs = likeliest(unit * size, law)
        written = np.diff(signs * size)
        unit = float(law @ law) / max(float(written @ law), 1e-300)
    return signs


def likeliest(size: Array, law: Array) -> Array:
    """Signs (n,) of sizes (n,) [N] whose increments follow those of a law (n - 1,) best."""
    before, after = size[:-1], size[1:]
    # Columns: the sign after is + or -.
    same = np.column_stack([(after - before - law) ** 2, (before - after - law) ** 2])
    crossed = np.column_stack([(after + before - law) ** 2, (-after - before - law) ** 2])
    costs, turned = np.zeros(2), np.zeros((len(law), 2), dtype=bool)
    for k in range(len(law)):
        stay, turn = costs + same[k], costs[::-1] + crossed[k]
        turned[k] = turn < stay
        costs = np.where(turned[k], turn, stay)
    signs, state = np.empty(len(size)), int(np.argmin(costs))
    for k in range(len(law), 0, -1):
        signs[k] = 1.0 - 2.0 * state
        state = 1 - state if turned[k - 1, state] else state
    signs[0] = 1.0 - 2.0 * state
    return signs
