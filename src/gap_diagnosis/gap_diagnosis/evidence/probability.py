"""How probable a statement is: what it shows, weighed as measured on sessions of known truth.

Statements are of four kinds: an effect that is named, one that was passed over, `unknown`, and
`none`. Each has features; a logistic regression of the truth on them gives the probability.
`make calibrate-diagnosis` fits the weights and writes `calibrated.py`. A name and `unknown` are
stated with no more than what they were worth on simulators that nobody had seen before.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from gap_diagnosis.evidence.acceptance import FAR, defining
from gap_diagnosis.evidence.calibrated import WEIGHTS
from gap_diagnosis.evidence.judgement import NONE, Cause
from stage_core.quantities import UNKNOWN, split_effect
from stage_twin.effects import effect_of, link_of

Features = dict[str, float]

#: A name in a verdict that holds `unknown`, too: what is not explained may have feigned it.
BESIDE_UNKNOWN = 'beside unknown'
#: An effect with an alternative, which the data cannot tell from it.
NOT_TOLD = 'not told from another'
#: No cause, beside a gap of more than `FAR` floors of the twin as its file states it: what the
#: model of a stated friction may leave, another effect may have made.
FAR_NONE = 'none beside a gap'

#: Features are cut off here: beyond it a session of the calibration shows no more.
LARGEST = 5.0


#: What statements were worth in the blind rows of simulators first seen, see "What statements were
#: worth" of docs/results/foreign_machines.md. The sessions of the fit come from machines that the
#: diagnosis was developed on: there it is 0.97 and 0.85.
FIRST_SEEN = {'named': 0.97, BESIDE_UNKNOWN: 0.83, NOT_TOLD: 0.82, UNKNOWN: 0.52, FAR_NONE: 0.5}


@dataclass(frozen=True)
class Scene:
    """What all statements about a session share.

    `gap` and `left` are the gap before and after over its floor, `share` is the largest share of
    a part's gap that stays structured, `turns` counts the reversals of each axis.
    """

    gap: float
    left: float
    share: float
    structured: bool
    turns: Mapping[str, int]


def kind_of(cause: Cause) -> str:
    """Kind of statement: `named`, `passed`, `unknown` or `none`."""
    if cause.effect in (UNKNOWN, NONE):
        return cause.effect if cause.status == 'accepted' else 'passed'
    return 'named' if cause.status == 'accepted' else 'passed'


def features(cause: Cause, causes: list[Cause], scene: Scene) -> Features:
    """Features of a statement; logarithms and counts, cut off at `LARGEST`.

    `causes` are the named effects, of which a passed effect may be a rival.
    """
    axis = split_effect(cause.effect)[1]
    turns = [n for a, n in scene.turns.items() if axis in (None, a)]
    link = link_of(cause.effect) if cause.effect not in (UNKNOWN, NONE) else ''
    raw = {
        'strength': _log(cause.strength),
        'shrink': _log(1.0 / max(1.0 - cause.shrink, 1e-9)),
        'surely': _log(1.0 / max(1.0 - cause.interval[0], 1e-9)),
        'away': _log(_away(cause)),
        'gap': _log(scene.gap),
        'left': _log(scene.left),
        'share': _log(scene.share),
        'turns': math.log1p(min(turns, default=0)),
        'rivals': float(len(cause.alternatives)),
        'rival': float(any(cause.effect in c.alternatives for c in causes)),
        'structured': float(scene.structured),
        'servo': float(link == 'servo'),
        'kinematic': float(link == 'kinematic'),
        'unknown': float(cause.effect == UNKNOWN),
    }
    return {name: min(max(value, -LARGEST), LARGEST) for name, value in raw.items()}


def probability(kind: str, values: Features, beside_unknown: bool = False) -> float:
    """Probability that a statement of a kind is true; `1` has the weight of the constant.

    It is no more than what such statements were worth on machines first seen.
    """
    weights = WEIGHTS[kind]
    total = weights['1'] + sum(w * values[n] for n, w in weights.items() if n != '1')
    fitted = 1.0 / (1.0 + math.exp(-total))
    kinds = [kind]
    if kind == 'named':
        untold = values.get('rivals', 0.0) > 0.0
        kinds += [BESIDE_UNKNOWN] * beside_unknown + [NOT_TOLD] * untold
    if kind == NONE and values.get('gap', 0.0) > math.log(FAR):
        kinds.append(FAR_NONE)
    return min(fitted, *(FIRST_SEEN.get(kind, 1.0) for kind in kinds))


def with_probabilities(causes: list[Cause], others: list[Cause], scene: Scene) -> list[Cause]:
    """Fill in the probabilities and order the list: accepted first, then by probability.

    What a name with alternatives lacks is theirs. Where at most one cause is at work the
    candidates exclude each other: what the statement leaves is dealt out in proportion.
    """
    everything = causes + others
    kinds = [kind_of(cause) for cause in everything]
    for cause, kind in zip(everything, kinds, strict=True):
        cause.features = features(cause, causes, scene)
        cause.probability = probability(kind, cause.features, UNKNOWN in kinds)
    for cause in causes:
        for other in (o for o in others if o.effect in cause.alternatives):
            share = (1.0 - cause.probability) / len(cause.alternatives)
            other.probability = max(other.probability, share)
    said = [c for c in everything if c.status == 'accepted']
    if len(said) == 1:
        rest = sum(c.probability for c in everything if c is not said[0])
        for cause in everything:
            if cause is not said[0]:
                cause.probability *= (1.0 - said[0].probability) / rest
    return causes + sorted(others, key=lambda c: (c.status != 'accepted', -c.probability))


def _log(value: float) -> float:
    return math.log(max(value, 1e-9))


def _away(cause: Cause) -> float:
    """Distance of the surest defining parameter from its neutral value, in its deviations."""
    if cause.effect in (UNKNOWN, NONE):
        return 1.0
    own = defining(cause.effect)
    found = [
        abs(cause.parameters[p.name][0] - (p.neutral or 0.0)) / cause.parameters[p.name][1]
        for p in effect_of(cause.effect).parameters
        if p.name in own and cause.parameters.get(p.name, (0.0, 0.0))[1] > 0.0
    ]
    return max(found, default=1.0)
