"""Two effects that are possible together, where none is by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gap_diagnosis.residuals.regression import Fit
from gap_diagnosis.selection.gains import block_rms_gains, bootstrap_interval
from gap_diagnosis.selection.model import Trial

if TYPE_CHECKING:
    from gap_diagnosis.selection.forward import Selector

#: Least share of the gap of an effect that is impossible alone, and of the pair: a force limit
#: explained 0.999 at a tenth of its value, and with the friction that it hides all but 1e-4.
NEARLY_ALL = 0.9


def pair(selector: Selector, base: Fit, trials: dict[str, Trial]) -> tuple[list[str], Fit] | None:
    """The pair that explains nearly all of the gap and most, if there is one.

    An amplifier that clips most of the time hides what the force has to overcome: by itself it
    takes an impossible value, and what it hides explains nothing for certain without it.
    """
    best: tuple[list[str], Fit] | None = None
    for name, trial in trials.items():
        if trial.evidence.admissible or trial.evidence.share < NEARLY_ALL:
            continue
        for other in [n for n, t in trials.items() if t.evidence.admissible]:
            start = selector.with_effect(selector.regression.linear(trials[other].thetas), name)
            fit = selector.regression.refine(start.thetas, list(start.thetas))
            if _stands(selector, base, fit) and (best is None or _less(selector, fit, best[1])):
                best = [other, name], fit
    return best


def _stands(selector: Selector, base: Fit, fit: Fit) -> bool:
    """Whether both are possible and explain nearly all of what is left without them."""
    left = fit.mean_square(selector.problem) - selector.noise
    if left > (1.0 - NEARLY_ALL) * (base.mean_square(selector.problem) - selector.noise):
        return False
    gains = block_rms_gains(selector.problem, base, fit)
    low, _ = bootstrap_interval(gains, selector.seed, level=selector.rules.level)
    return low > 0.0 and all(selector.admissible(fit, n) for n in fit.thetas)


def _less(selector: Selector, one: Fit, other: Fit) -> bool:
    return one.mean_square(selector.problem) < other.mean_square(selector.problem)
