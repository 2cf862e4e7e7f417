"""Forward selection by other ways: with an effect that another one was taken before.

A selection that grows by the best single effect may take a rich one for two plain ones: a yaw of
many orders for a scale error beside a small yaw. So the effects that gained about as much are
tried in its place, and the set that predicts better, or as well with less, is taken. Tried in the
same way are the special cases of which an effect may be the mere sum, as of a friction that is the
same in both directions.
"""

from __future__ import annotations

from gap_diagnosis.evidence.acceptance import untold
from gap_diagnosis.evidence.describe import describe
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.gains import block_gains, bootstrap_interval
from gap_diagnosis.selection.model import Selection
from stage_twin.effects import EFFECTS
from stage_twin.effects.term import Term

#: Share of the gain of the effect that was taken, from which on another one is tried in its place.
#: A true scale error beside a yaw had 0.66, effects that were not there less than 0.15.
NEARLY = 0.3
#: Number of those that are tried: each costs a selection.
MOST = 2


def select_best(selector: Selector) -> Selection:
    """The best of the forward selections that take effects of about the same gain first."""
    plain, whole = dict(selector.problem.terms), selector.gap
    best = selector.select()
    for name, before in _overtaken(selector, best.accepted):
        best = _other_way(selector, best, [*before, name], plain, whole)
    for name in list(best.accepted):
        effect, _, axis = name.partition('.')
        parts = [f'{part}.{axis}' for part in EFFECTS[effect].sums]
        if parts and all(part in plain for part in parts):
            others = {name, *(f'{held}.{axis}' for held in EFFECTS[effect].holds)} - {*parts}
            before = best.accepted[: best.accepted.index(name)]
            known = {n: t for n, t in plain.items() if n not in others}
            best = _other_way(selector, best, [*before, *parts], known, whole)
    return best


def _other_way(
    selector: Selector, best: Selection, first: list[str], known: dict[str, Term], gap: float
) -> Selection:
    """The better one of a selection and another that begins with some of the known effects."""
    terms = selector.problem.terms
    shapes, own = dict(terms), selector.gap
    terms.clear()
    terms.update(known)
    selector.gap = gap
    other = selector.select(first)
    better = _better(selector, other, best)
    found, doubted = dict(terms), _untold(selector, other) if better else set()
    terms.clear()
    terms.update(shapes)
    if better and doubted <= _untold(selector, best):
        terms.update(found)
        return other
    selector.gap = own
    return best


def _overtaken(selector: Selector, accepted: list[str]) -> list[tuple[str, list[str]]]:
    """Effects that gained nearly as much as one that was taken, with the set until then.

    Those that hold an accepted one, or are held by one, were compared with it already. One that
    was accepted later is tried first where it is plainer: beside it the other one may be nothing.
    """
    found = [
        (passed.share, name, passed.before)
        for name, passed in selector.passed.items()
        if passed.share >= NEARLY
        and (passed.plainer or name not in accepted)
        and not selector.contained(name, accepted)
        and not selector.replaced(name, accepted)
    ]
    found = sorted(found, key=lambda entry: (-entry[0], entry[1]))[:MOST]
    return [(name, before) for _, name, before in found]


def _untold(selector: Selector, selection: Selection) -> set[str]:
    """Effects of a set that may as well be nothing, as what an imitation leaves of a true one."""
    found = describe(selection, selector.regression)
    return {name for name in selection.accepted if untold(name, found[name])}


def _better(selector: Selector, other: Selection, best: Selection) -> bool:
    """Whether a set predicts better than the best one for certain, or no worse with less.

    With as many parameters the likelier set is the one that predicts better, if ever so little.
    What both sets hold does not say how much the others have to gain.
    """
    gains = block_gains(selector.problem, best.fit, other.fit)
    gain = float(gains.mean())
    low, high = bootstrap_interval(gains, selector.seed, level=selector.rules.level)
    apart = ({*other.accepted} ^ {*best.accepted}) & {*selector.problem.terms}

    def least(lesser: Selection) -> float:
        rest = max(lesser.fit.mean_square(selector.problem) - selector.noise, 0.0)
        return max((selector.least(n, abs(gain), rest) for n in apart), default=0.0)

    if low > 0.0 and gain > least(best):
        return True
    loses = high < 0.0 and -gain > least(other)
    return not loses and (other.fit.size, -gain) < (best.fit.size, 0.0)
