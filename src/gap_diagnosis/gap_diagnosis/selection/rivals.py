"""Effects that could take the place of an accepted one at no significant cost."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gap_diagnosis.residuals.regression import Fit
from gap_diagnosis.selection.gains import block_gains, bootstrap_interval
from gap_diagnosis.selection.model import Evidence
from stage_twin.effects import effect_of

if TYPE_CHECKING:
    from gap_diagnosis.selection.forward import Selector

#: Share of what an effect leaves unexplained that a rival has to explain in its place.
LEAST_OF_REST = 0.5
#: Loss by a rival, as a share of the effect's own gain, that is none.
CLOSE = 0.05


def find_rivals(
    selector: Selector, accepted: list[str], fit: Fit, evidence: dict[str, Evidence]
) -> None:
    """Add to the evidence of each effect those that do as well in its place (`alternatives`)."""
    problem = selector.problem
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


def _replaces(selector: Selector, less: Fit, fit: Fit, evidence: Evidence, rival: str) -> bool:
    """Whether a rival, added to the set without the effect, does as well as the effect."""
    problem = selector.problem
    other = selector.with_effect(less, rival)
    if not selector.admissible(other, rival):
        return False
    loss = block_gains(problem, other, fit)
    gained = float(block_gains(problem, less, other).mean())
    rest = max(less.mean_square(problem) - selector.noise, 1e-300)
    holder = evidence.name.partition('.')[0] in effect_of(rival).holds
    close = float(loss.mean()) < CLOSE * evidence.gain
    low, _ = bootstrap_interval(loss, selector.seed, level=selector.rules.level)
    return gained > LEAST_OF_REST * rest and not holder and (close or low <= 0.0)
