"""A set at its optimum or, where no machine has that, as near to it as machines go."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gap_diagnosis.residuals.regression import Fit
from stage_twin.effects import effect_of
from stage_twin.effects.term import Theta

if TYPE_CHECKING:
    from gap_diagnosis.selection.forward import Selector

FRAME = 'tracker_misalignment'
HALVINGS = 5  # of the way to an optimum that no machine has


def refined(
    selector: Selector, thetas: dict[str, Theta], names: Sequence[str], rounds: int = 12
) -> Fit:
    """A set with the nonlinear parameters of `names` at their optimum (`Regression.refine`).

    An optimum may be flat, and impossible: of a friction that still falls at the highest speed
    all that is known at high speed is that it is less. Then the last possible set on the way to
    it is taken, if that explains as much.
    """
    best = selector.regression.refine(thetas, names, rounds)
    if _possible(selector, best):
        return best
    edge = selector.regression.linear(thetas)
    if not _possible(selector, edge):
        return best
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        share = 0.5 * (low + high)
        between = selector.regression.linear(
            {
                n: tuple(a + share * (b - a) for a, b in zip(theta, best.thetas[n], strict=True))
                for n, theta in thetas.items()
            }
        )
        if _possible(selector, between):
            low, edge = share, between
        else:
            high = share
    return edge if as_good(selector, edge, best) else best


def as_good(selector: Selector, other: Fit, best: Fit) -> bool:
    """Whether a set leaves hardly more than the best one."""
    now = best.mean_square(selector.problem)
    return other.mean_square(selector.problem) < max(1.05 * now, now + 1e-3 * selector.gap)


def _possible(selector: Selector, fit: Fit) -> bool:
    return all(selector.admissible(fit, n) for n in fit.thetas)


def too_few_places(selector: Selector, fit: Fit, name: str) -> bool:
    """Whether the effects of an axis, or all together, pass through any places like its rests.

    Whatever there is, a curve of k parameters meets k places; it says nothing of others. The
    frame of the tracker has parameters too: one along each axis, and all those of its effect.
    A play differs by the side of an approach, not by the place, but between two places one side
    is one place.
    """
    rested, axis = selector.problem.places, name.partition('.')[2]
    if rested is None or axis not in ('', *rested.places):
        return False
    own = {n for n in fit.thetas if axis in ('', n.partition('.')[2])} - {FRAME}
    sizes = {n: selector.size(n) for n in own}
    curves = sum(size for n, size in sizes.items() if not effect_of(n).reverses)
    if not axis:
        frame = selector.size(FRAME) if FRAME in selector.problem.terms else 1
        return curves + frame >= rested.numbers
    few = max(curves, 1) + 1 >= rested.places[axis]
    return few or sum(sizes.values()) + 1 >= rested.approaches[axis]
