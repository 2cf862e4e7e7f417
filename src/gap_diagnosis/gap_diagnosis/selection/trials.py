"""One effect tried beside a set, in the shape in which it predicts best."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gap_diagnosis.residuals.regression import Fit
from gap_diagnosis.selection.model import Trial
from stage_twin.effects.term import Term

if TYPE_CHECKING:
    from gap_diagnosis.selection.forward import Selector

#: Share of the least gain that counts, or of the noise if that is less, by which an effect has to
#: change the held-out mean square where the search of its parameters starts. Of 4527 trials on 40
#: sessions of two foreign simulators 393 came to count: they had started at 0.89 or more. 1879
#: started below this share.
HOPELESS = 0.2


def best_shape(selector: Selector, base: Fit, name: str, accepted: list[str]) -> Trial:
    """An effect in its plain shape or, where that shows nothing, a curve in a richer one.

    It is the one that predicts best, if the richest of all counts. A shape that finds its
    place in the residual (`Term.propose`) is left to `grow`.
    """
    shape = selector.problem.terms[name]
    plain = _shaped(selector, base, name, shape, accepted)
    shapes: list[Term] = []
    richer = shape.next if shape.propose is None else None
    while richer is not None and richer.propose is None:
        shapes.append(richer)
        richer = richer.next
    if not shapes or selector.counts(plain.evidence, base):
        return plain
    richest = _shaped(selector, base, name, shapes[-1], accepted)
    if not selector.counts(richest.evidence, base):
        return plain
    found = [_shaped(selector, base, name, s, accepted) for s in shapes[:-1]]
    return max([richest, *found], key=lambda trial: trial.evidence.gain)


def _shaped(selector: Selector, base: Fit, name: str, shape: Term, accepted: list[str]) -> Trial:
    """An effect in one shape, which it has from now on, in the place of what it holds."""
    selector.problem.terms[name] = shape
    less = selector.without(base, selector.replaced(name, accepted))
    theta = selector.regression.warm_start(less, name)
    fit = selector.regression.linear({**less.thetas, name: theta})
    if not _hopeless(selector, base, fit, name):
        fit = selector.with_effect(less, name)
    return Trial(selector.evidence(name, base, fit), fit.thetas, shape)


def _hopeless(selector: Selector, base: Fit, start: Fit, name: str) -> bool:
    """Whether an effect changes next to nothing where the search of its parameters starts."""
    changed = base.mean_square(selector.problem) - start.mean_square(selector.problem)
    return abs(changed) < HOPELESS * min(selector.least(name), selector.noise)
