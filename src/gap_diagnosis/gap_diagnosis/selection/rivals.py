"""Effects that could take the place of an accepted one at no significant cost."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gap_diagnosis.residuals.regression import Fit
from gap_diagnosis.selection.gains import block_gains, bootstrap_interval
from gap_diagnosis.selection.grow import grow
from gap_diagnosis.selection.model import Evidence, Selection
from stage_twin.effects import effect_of

if TYPE_CHECKING:
    from gap_diagnosis.selection.forward import Selector

#: Share of what an effect explains that a rival has to explain in its place.
LEAST_OF_ITS_GAIN = 0.5


def find_rivals(selector: Selector, selection: Selection) -> None:
    """Add to the evidence of each effect those that do as well in its place (`alternatives`)."""
    problem, fit = selector.problem, selection.fit
    accepted, evidence = selection.accepted, selection.evidence
    for name in accepted:
        if name in selector.rules.kept:
            continue
        others = [a for a in accepted if a != name]
        less = selector.without_effect(fit, name)
        for rival in problem.terms:
            if rival in accepted or selector.barred(rival, others):
                continue
            if _replaces(selector, less, fit, evidence[name], rival):
                evidence[name].alternatives.append(rival)
    selector.regression.forget()


def _replaces(selector: Selector, less: Fit, fit: Fit, evidence: Evidence, rival: str) -> bool:
    """Whether a rival, added to the set without the effect, does as well as the effect.

    One that has the effect as a special case always does, and is none.
    """
    if evidence.name.partition('.')[0] in effect_of(rival).holds:
        return False
    other = selector.with_effect(less, rival)
    if not selector.admissible(other, rival):
        return False
    problem = selector.problem
    gained, its = (float(block_gains(problem, less, with_one).mean()) for with_one in (other, fit))
    if gained <= max(LEAST_OF_ITS_GAIN * its, 0.0):
        return False
    if not problem.signal:
        other = _grown(selector, other, rival)
    return not _told(selector, fit, other, evidence.name)


def _grown(selector: Selector, fit: Fit, rival: str) -> Fit:
    """A set with a rival in as rich a shape as data bear.

    On a straight path one curve of the table's error is that of either axis.
    """
    terms = selector.problem.terms
    plain = terms[rival]
    grown = grow(selector, fit, [rival])
    terms[rival] = plain
    return grown


def _told(selector: Selector, fit: Fit, other: Fit, name: str) -> bool:
    """Whether a set with a rival in the place of an effect loses for certain, and enough.

    That is as much as any effect has to gain, and more than what the set with the effect leaves
    above the noise: by as much its models may be wrong. On sessions of another simulator a mass
    and a drive gain, and two resonances, lost 0.4 to 0.7 of that in the place of each other. On
    machines of the twin wrong frictions lost 100 times as much, a wrong drive gain 20 times.
    """
    problem = selector.problem
    loss = block_gains(problem, other, fit)
    low, _ = bootstrap_interval(loss, selector.seed, level=selector.rules.level)
    unexplained = fit.mean_square(problem) - selector.noise
    return low > 0.0 and float(loss.mean()) > max(selector.least(name), unexplained)
