"""Weights of the rows of a force balance: models of friction are crude near standstill.

What a fit leaves of a machine with friction depends on the speed: while the bristles bend or
creep, no two models agree. Rows count by what is left at their speed (feasible generalised least
squares: Greene, Econometric analysis, 2018, chapter 9), so that the sliding rows say how large a
friction is, and what acts beside it.
"""

from __future__ import annotations

import numpy as np

from gap_diagnosis.evidence.describe import model_of
from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.selection.model import Selection
from stage_core.arrays import Array
from stage_twin.effects import effect_of

#: Edges of the classes of speed, over the root mean square of the speeds.
EDGES = (0.03, 0.1, 0.3, 1.0)
#: Least rows of a class that has a variance of its own.
FEWEST = 200
#: Ratio of the variances of two classes from which on rows are weighted.
UNEQUAL = 4.0


def speed_weights(problem: Problem, selection: Selection) -> Array | None:
    """Weights (n,), 1 at the most; None where all rows count alike.

    Beside a friction that was accepted, or what the twin states of its own: a friction as a rule.
    """
    frictions = [n for n in selection.accepted if model_of(n) == 'friction']
    if problem.speed is None or not (frictions or problem.stated):
        return None
    usual = float(np.sqrt(np.mean(problem.speed**2)))
    labels = np.digitize(problem.speed, [edge * usual for edge in EDGES])
    squares = selection.fit.residual**2
    variance = np.full(len(EDGES) + 1, np.nan)
    for label in range(len(variance)):
        rows = problem.fit & (labels == label)
        if np.count_nonzero(rows) >= FEWEST:
            variance[label] = max(float(np.mean(squares[rows])), problem.floor**2)
    least = float(np.nanmin(variance))
    if not np.nanmax(variance) > UNEQUAL * least:
        return None
    weights = np.sqrt(least / np.where(np.isnan(variance), np.nanmax(variance), variance))
    return np.asarray(weights[labels])


def offered(name: str, selection: Selection) -> bool:
    """Whether an effect is a candidate once rows count by their speed.

    A force along the travel has to be shown by rows that count alike, but for a found friction.
    Rows that count less leave places untold, where a curve has any shape: behind a stated friction
    such a force was named too much beside a right one of two simulators.
    """
    found = any(model_of(n) == 'friction' for n in selection.accepted)
    return found or name in selection.accepted or not effect_of(name).along_travel
