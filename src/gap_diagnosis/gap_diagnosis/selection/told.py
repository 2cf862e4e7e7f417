"""Which of two effects that do as well in the force balance the closed loop follows better.

The recorded force answers to the encoder's noise through the controller, and the rows of the
force balance hold that noise, too. So a column that is nearly the slope of the force (a delay, a
lag) takes part of the controller's answer for the plant's. The reference of the loop holds none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gap_diagnosis.closed_loop.axis_loop import LEFT, AxisLoop
from gap_diagnosis.evidence.acceptance import FAR_BESIDE
from gap_diagnosis.evidence.describe import describe
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.gains import bootstrap_interval
from gap_diagnosis.selection.model import Evidence, Selection
from gap_diagnosis.selection.parts import Part
from stage_core.arrays import Array
from stage_twin.effects import effect_of

#: Share of the least gap that a set leaves below which another one takes its place where the loop
#: stays far from the record with either. On two seeds of foreign simulators a right delay or lag
#: left 0.60 and 0.63 of what the wrong one did, wrong alternatives 1.07 and more.
MUCH_CLOSER = 0.7
#: The same below which one of more parameters does, where the loop follows the record: a torque
#: that sags at once is a gain of the drive, and left 0.95 of what the right gain did.
RICHER = 0.7


def told_by_loop(part: Part, loop: AxisLoop) -> Selection:
    """The selection in which the loop decides between accepted effects and their alternatives.

    One with which the loop follows the held-out record worse for certain is no alternative, nor
    is one beside which no machine has the others. One with more parameters has to follow it much
    closer. A loop that swings decides nothing. One that stays far from the record says which comes
    much closer with the parameters that suit it best.
    """
    selector, selection = part.selector, part.selection

    def gaps(other: Selection) -> Array:
        return loop.window_gaps(describe(other, selector.regression))

    for name in [n for n in selection.accepted if not effect_of(n).swings]:
        for rival in list(selection.evidence[name].alternatives):
            if effect_of(rival).swings:
                continue
            other = exchanged(selector, selection, name, rival)
            possible = all(selector.admissible(other.fit, n) for n in other.accepted)
            mine, its = gaps(selection), gaps(other)
            if min(_rms(mine), _rms(its)) > FAR_BESIDE * loop.floor:
                if possible and _much_closer(selector, loop, other, selection):
                    selection = other
                    break
                continue
            low, high = bootstrap_interval(mine - its, selector.seed, level=selector.rules.level)
            if not possible or high < 0.0:
                selection.evidence[name].alternatives.remove(rival)
            elif low > 0.0 and (not _richer(other, selection) or _rms(its) < RICHER * _rms(mine)):
                selection = other
                break
    return selection


def told_where_it_slides(
    part: Part, selection: Selection, loop: AxisLoop, own: Evidence, others: Sequence[str]
) -> bool:
    """Whether the loop comes far closer with an effect than with others in its place.

    That is so behind a friction that the twin states, where the axis slides.
    """
    sliding, selector = loop.beside([own.name]), part.selector
    if not sliding.sliding:
        return False

    def gap(some: Selection) -> float:
        return sliding.gap(loop.with_known(loop.refined(describe(some, selector.regression))))

    rivals = [exchanged(selector, selection, own.name, other) for other in others]
    return gap(selection) < LEFT * min(gap(rival) for rival in rivals)


def _much_closer(
    selector: Selector, loop: AxisLoop, other: Selection, selection: Selection
) -> bool:
    """Whether another set comes much closer to a record that neither follows."""
    loop = loop.beside([*other.accepted, *selection.accepted])
    its, mine = (loop.closest(describe(s, selector.regression)) for s in (other, selection))
    return its < MUCH_CLOSER * mine


def _richer(other: Selection, selection: Selection) -> bool:
    """Whether another set has more parameters."""
    return other.fit.size > selection.fit.size


def _rms(gaps: Array) -> float:
    return float(np.sqrt(np.mean(gaps**2)))


def exchanged(selector: Selector, selection: Selection, name: str, rival: str) -> Selection:
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
