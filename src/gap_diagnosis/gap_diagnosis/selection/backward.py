"""Selection backwards: from all effects at once, for few rows with a small known noise.

Of tens of rests each effect alone explains little beside all the others, and none would be the
first of a forward selection. Fitted together they leave little more than the noise, and each
shows by what is lost without it.
"""

from __future__ import annotations

import math
from dataclasses import replace

from gap_diagnosis.residuals.regression import Fit
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.model import Rules, Selection
from gap_diagnosis.selection.possible import too_few_places
from stage_twin.effects import effect_of

#: Rows for each free coefficient, below which all effects at once explain anything.
ROWS_PER_COEFFICIENT = 2.5


def select_backwards(
    selector: Selector, forward: Selection, unknown_noise: Rules | None = None
) -> Selection:
    """The better of a forward selection and of one that starts from all effects.

    Better is the one that predicts rows better that did not fit it (`Fit.crossed`).

    Parameters
    ----------
    unknown_noise : where the rows scatter by more than the problem's floor, and nobody knows by
        how much: what all effects together leave is the noise then, judged by these rules
    """
    fit = _everything(selector)
    if fit is None:
        return forward
    if unknown_noise is not None:
        floor = max(selector.problem.floor, math.sqrt(fit.mean_square(selector.problem)))
        problem = replace(selector.problem, floor=floor)
        selector = Selector(problem, unknown_noise, selector.seed, selector.raw)
    accepted, fit, evidence = selector.prune(list(fit.thetas), fit)
    problem = selector.problem
    if not accepted or fit.mean_square(problem) >= forward.fit.mean_square(problem):
        return forward
    rejected = {n: e for n, e in forward.rejected.items() if n not in accepted}
    return Selection(accepted, fit, evidence, rejected)


def _everything(selector: Selector) -> Fit | None:
    """All effects that hold no other as a special case; None where rows or places are too few."""
    problem, regression = selector.problem, selector.regression
    names = [n for n in problem.terms if not effect_of(n).holds]
    linear = {n: problem.terms[n].grid[0] for n in names if not problem.terms[n].lower}
    coefficients = sum(regression.columns(n, t).shape[1] for n, t in linear.items())
    others = [n for n in names if n not in linear]
    rows = int(problem.fit.sum())
    if rows < ROWS_PER_COEFFICIENT * (coefficients + len(others)):
        return None
    fit = regression.linear(linear)
    for name in others:
        fit = selector.with_effect(fit, name)
    fit = regression.refine(fit.thetas, others)
    if any(too_few_places(selector, fit, n) for n in names):
        return None
    # What takes an impossible value beside all the others is none of them.
    while not_physical := [n for n in fit.thetas if not selector.admissible(fit, n)]:
        fit = selector.without_effect(fit, not_physical[0])
    return fit
