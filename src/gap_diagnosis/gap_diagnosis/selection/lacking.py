"""An effect that a force balance shows too little of, and the closed loop shows well.

Beside a friction the errors of its model are the largest part of what a balance leaves, so that a
delay or a lag explains a small share of it. The loop follows the record far better with it.
"""

from __future__ import annotations

import math
from dataclasses import replace

from gap_diagnosis.closed_loop.axis_loop import FOLLOWS, LEFT, AxisLoop
from gap_diagnosis.closed_loop.dither import sticks
from gap_diagnosis.closed_loop.slides import slides
from gap_diagnosis.evidence.describe import describe
from gap_diagnosis.selection.model import Selection, Trial
from gap_diagnosis.selection.parts import Part
from stage_twin.effects import effect_of

#: Number of effects that are tried: each costs a refinement in the loop.
MOST = 4


def with_lacking(part: Part, loop: AxisLoop) -> Part:
    """The part with the effect beside which the loop follows the held-out record far better.

    Behind a friction that the twin states that may be where the axis slides.
    """
    whole = _with_best(part, loop)
    if whole is not part or not slides(loop.records, loop.twin, loop.axis):
        return whole
    return _with_best(part, replace(loop, sliding=True))


def _with_best(part: Part, loop: AxisLoop) -> Part:
    """The part with the effect beside which the loop leaves least; the part where none is far."""

    def gap(some: Part) -> float:
        found = describe(some.selection, some.selector.regression)
        return loop.gap(loop.with_known(loop.refined(found)))

    before = gap(part)
    if before < FOLLOWS * loop.floor or math.isinf(before):
        return part
    best, least = part, LEFT * before
    for trial in _candidates(part, loop):
        other = _with_trial(part, trial)
        if not all(
            part.selector.admissible(other.selection.fit, n) for n in other.selection.accepted
        ):
            continue
        left = gap(other)
        if left < least:
            best, least = other, left
    return best


def _candidates(part: Part, loop: AxisLoop) -> list[Trial]:
    """Effects that explain something of the remainder for certain, the largest first.

    Other values of those that the twin states have to explain more than a model's error. No
    friction is told where the axis slides alone.
    """
    error = part.selector.rules.of_gap * part.problem.stated
    selector, selection = part.selector, part.selection
    trials = selector.trials(selection.fit, selection.accepted).values()
    good = [
        t
        for t in trials
        if t.evidence.admissible and t.evidence.interval[0] > 0.0
        if not t.odd and not effect_of(t.evidence.name).swings
        if t.evidence.name not in loop.twin.effects or t.evidence.gain > error
        if not (loop.sliding and sticks([t.evidence.name]))
    ]
    return sorted(good, key=lambda t: (-t.evidence.gain, t.evidence.name))[:MOST]


def _with_trial(part: Part, trial: Trial) -> Part:
    """The part with one more effect, in the place of what it holds as a special case."""
    selector, old, name = part.selector, part.selection, trial.evidence.name
    fit = selector.regression.refine(trial.thetas, list(trial.thetas))
    rejected = {n: e for n, e in old.rejected.items() if n != name}
    accepted = [n for n in old.accepted if n in trial.thetas]
    evidence = {n: old.evidence[n] for n in accepted}
    selection = Selection([*accepted, name], fit, {**evidence, name: trial.evidence}, rejected)
    return replace(part, selection=selection)
