"""What the innovations of a force balance say of effects whose column is a slope of the force."""

from __future__ import annotations

import math
from dataclasses import replace

from gap_diagnosis.closed_loop.polish import AGREEMENT
from gap_diagnosis.evidence.describe import describe
from gap_diagnosis.residuals.innovations import innovations
from gap_diagnosis.residuals.regression import Regression
from gap_diagnosis.residuals.servo import Servo
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.gains import block_rms_gains, bootstrap_interval
from gap_diagnosis.selection.model import Selection
from stage_twin.effects import effect_of


def told_by_innovations(selector: Selector, selection: Selection, rows: Servo) -> Selection:
    """The selection in which the innovations decide between a delay and a lag, and say how large.

    The one that leaves more of them for certain is no alternative, nor is one beside which no
    machine has the others. Only effects without free
    coefficients are compared: one that scales a mass or a force scales the noise of the rows,
    too, and squares of different units say nothing. Of a loop that swings no noise model holds.
    """
    terms = selector.problem.terms
    for name in [n for n in selection.accepted if terms[n].fixed and not effect_of(n).swings]:
        for rival in list(selection.evidence[name].alternatives):
            if terms[rival].fixed and not effect_of(rival).swings:
                other = _exchanged(selector, selection, name, rival)
                possible = all(selector.admissible(other.fit, n) for n in other.accepted)
                low, high = _gain(selector, selection, other, rows)
                if not possible or high < 0.0:
                    selection.evidence[name].alternatives.remove(rival)
                elif low > 0.0:
                    selection, name = other, rival
                    break
        selection = _surer(selector, selection, name, rows)
    return selection


def _exchanged(selector: Selector, selection: Selection, name: str, rival: str) -> Selection:
    """The selection with an alternative in the place of an accepted effect."""
    less = selector.without_effect(selection.fit, name)
    thetas = selector.with_effect(less, rival).thetas
    fit = selector.regression.refine(thetas, list(thetas))
    evidence = {n: e for n, e in selection.evidence.items() if n != name}
    # An alternative does about as well by definition, and so do the others.
    own = selection.evidence[name]
    others = [a for a in own.alternatives if a != rival]
    evidence[rival] = replace(own, name=rival, alternatives=others)
    accepted = [rival if n == name else n for n in selection.accepted]
    rejected = {n: e for n, e in selection.rejected.items() if n != rival}
    return Selection(accepted, fit, evidence, rejected)


def _gain(
    selector: Selector, named: Selection, other: Selection, rows: Servo
) -> tuple[float, float]:
    """Interval of how much less another selection leaves of the innovations."""
    problem, fit = innovations(rows, named.fit)
    gains = block_rms_gains(problem, fit, innovations(rows, other.fit)[1])
    return bootstrap_interval(gains, selector.seed, level=selector.rules.level)


def _surer(selector: Selector, selection: Selection, name: str, rows: Servo) -> Selection:
    """The selection with the parameters of an effect from the innovations where they are surer.

    No noise model is exact: a deviation stays that of the plain rows, and holds the distance of
    the two estimates.
    """
    problem, fit = innovations(rows, selection.fit)
    white = replace(selection, fit=fit, told={})
    plain = describe(selection, selector.regression)[name]
    told = describe(white, Regression(problem))[name]
    if any(told[key][1] > std for key, (_, std) in plain.items()):
        return selection
    both = {
        key: (told[key][0], math.hypot(std, AGREEMENT * (told[key][0] - value)))
        for key, (value, std) in plain.items()
    }
    return replace(selection, told={**selection.told, name: both})
