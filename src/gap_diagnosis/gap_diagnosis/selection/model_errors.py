"""Drives that seem weaker, and others, by the errors of other models in a force balance.

Models of a friction are approximations. Their errors go with the force of the axis where it
reverses, so that a drive which gives a little less force explains a part of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gap_diagnosis.evidence.describe import model_of
from gap_diagnosis.residuals.regression import Fit
from gap_diagnosis.selection.forward import LACKING
from gap_diagnosis.selection.model import Evidence, Selection
from gap_diagnosis.selection.parts import Part
from stage_twin.effects import effect_of


def model_errors(
    part: Part, selection: Selection, told: Callable[[Evidence, Sequence[str]], bool]
) -> list[str]:
    """Effects of a balance that errors of models may have left, with what can replace them.

    The errors are those of the models of other effects, or of one that the twin states, unless the
    loop has `told` an effect from its other values. Where a scale is one, no other one is looked
    for.
    """
    fit, evidence, accepted = selection.fit, selection.evidence, selection.accepted
    stated = [evidence[n] for n in accepted if _of_stated(part, evidence[n])]
    found = [own for own in stated if not told(own, _of_twin(part, own))]
    scales = [n for n in part.problem.terms if effect_of(n).scales]
    wrong = [evidence[n] for n in scales if n in accepted and _of_others(part, fit, evidence[n])]
    gone = [n for own in found + wrong for n in (own.name, *own.alternatives)]
    return list(dict.fromkeys([*gone, *(n for n in scales if wrong and n not in accepted)]))


def _of_others(part: Part, fit: Fit, own: Evidence) -> bool:
    """Whether an effect explains little of what is left without it, where models leave much.

    Or whether it is less than the error of the model of a friction beside it. On 80 sessions of
    two foreign simulators drive gains that were wrong explained 0.13, 0.22 and 0.51 of a remainder
    beyond the noise; a mass and a viscous friction, which took their place where they had been
    left out, 0.10 and 0.16. Beside a friction wrong ones were 1.4e-5 and 1.4e-4 of its squares,
    right ones 0.06 and more.
    """
    noise = part.selector.noise
    much = fit.mean_square(part.problem) - noise > noise and not part.structure.structured
    frictions = [n for n in fit.thetas if model_of(n) == 'friction']
    error = part.selector.rules.of_gap * sum(_square(part, fit, n) for n in frictions)
    return (much and own.share < LACKING) or _square(part, fit, own.name) < error


def _square(part: Part, fit: Fit, name: str) -> float:
    """Mean square of what an effect explains on the rows that judge."""
    return float(np.mean(fit.contribution(part.problem, name)[part.problem.judged] ** 2))


def _of_stated(part: Part, own: Evidence) -> bool:
    """Whether other values of a stated effect explain as much, and its model may have left it.

    As those values would have to, it has to explain more than the error of that model.
    """
    error = part.selector.rules.of_gap * part.problem.stated
    return own.gain < error and bool(_of_twin(part, own))


def _of_twin(part: Part, own: Evidence) -> list[str]:
    """The alternatives of an effect that are other values of what the twin states."""
    return [a for a in own.alternatives if part.problem.terms[a].base is not None]
