"""What a diagnosis leaves open, as candidates that an experiment has to tell apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gap_diagnosis.evidence.acceptance import defining
from gap_diagnosis.evidence.describe import describe
from gap_diagnosis.evidence.judgement import Cause
from gap_diagnosis.parameters import Parameters
from gap_diagnosis.residuals.regression import Fit
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.selection.model import Selection
from gap_diagnosis.selection.parts import Part
from stage_core.metrics import SIGMAS
from stage_twin.effects import effect_of

#: Rivals of one effect that are simulated.
MOST = 4
#: Of an effect with more parameters, such as a curve, some are nothing without being a question.
FEW = 3
LARGE = 'large'


@dataclass(frozen=True)
class Pair:
    """Two candidates between which the session cannot decide.

    Attributes
    ----------
    names : what each stands for
    one, two : effects of the twin with their parameters (value, standard deviation)
    common : effects that both have
    """

    names: tuple[str, str]
    one: Parameters
    two: Parameters
    common: Parameters


def open_pairs(found: Diagnosis) -> list[Pair]:
    """Every pair that an experiment should tell apart; empty where no question is open."""
    accepted = {n: found.parameters[n] for n in found.accepted}
    pairs = []
    for cause in found.causes:
        if cause.status == 'accepted' and cause.effect in accepted:
            pairs += list(_rivals(found, cause, accepted))
            pairs += list(_sizes(cause, accepted))
    return pairs


def _rivals(found: Diagnosis, cause: Cause, accepted: Parameters) -> Iterator[Pair]:
    """The effect beside each that could take its place, fitted there."""
    rest = {n: v for n, v in accepted.items() if n != cause.effect}
    for part in found.parts:
        if cause.effect not in part.selection.accepted:
            continue
        for rival in cause.alternatives[:MOST]:
            if rival in part.selector.problem.terms:
                less = part.selector.without_effect(part.selection.fit, cause.effect)
                fitted = _fitted(part, part.selector.with_effect(less, rival))
                yield Pair((cause.effect, rival), accepted, {**rest, **fitted}, rest)


def _sizes(cause: Cause, accepted: Parameters) -> Iterator[Pair]:
    """Both ends of the interval of a parameter that may as well be nothing."""
    own = defining(cause.effect)
    for name in own if len(own) <= FEW else ():
        value, std = cause.parameters.get(name, (0.0, 0.0))
        known = effect_of(cause.effect).parameter(name)
        if known.neutral is None or abs(value - known.neutral) > SIGMAS * std:
            continue
        ends = []
        for sign in (-1.0, 1.0):
            end = min(max(value + sign * SIGMAS * std, known.minimum), known.maximum)
            ends.append({**accepted, cause.effect: {**accepted[cause.effect], name: (end, 0.0)}})
        rest = {n: v for n, v in accepted.items() if n != cause.effect}
        yield Pair((f'{cause.effect}: {name} small', LARGE), ends[0], ends[1], rest)


def _fitted(part: Part, fit: Fit) -> Parameters:
    selection = Selection(list(fit.thetas), fit, {}, {})
    return describe(selection, part.selector.regression)


def separated(pairs: list[tuple[str, str]]) -> list[str]:
    """Names of all candidates, each once; a parameter is its effect's."""
    names = [name for pair in pairs for name in pair if name != LARGE]
    return list(dict.fromkeys(name.partition(':')[0] for name in names))
