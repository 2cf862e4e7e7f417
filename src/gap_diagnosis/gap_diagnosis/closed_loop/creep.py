"""Stated frictions that give way at rest as those of the machine do.

A friction that is a smooth function of the speed lets an axis creep under the least force. A twin
whose friction holds then rests at other places. Where one that gives way follows the fitted ticks
much closer, the twin is run with it. So it is with a friction that builds up over another
presliding than the stated one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from scipy.optimize import minimize_scalar

from gap_diagnosis.closed_loop.replay import fitted_gap
from gap_diagnosis.closed_loop.rests import CLOSER, with_rests
from gap_diagnosis.evidence.describe import model_of
from gap_diagnosis.input.data import Record
from gap_diagnosis.parameters import Effects
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile
from stage_core.wording import effect_words
from stage_twin.effects.friction import CREEP, PRESLIDING

#: Share of the gap that is left where the friction of a machine gives way: 0.006 to 0.41 on eight
#: machines of a foreign simulator, 0.52 on a ninth; 0.6 and more on 102 other axes of five.
MUCH_CLOSER = 0.5


def with_creep(records: Sequence[Record], twin: TwinFile) -> TwinFile:
    """The twin, whose stated frictions give way as the machine's do."""
    for axis in records[0].axes if twin.kind == 'servo' else ():
        own = [n for n in twin.effects if split_effect(n)[1] == axis and model_of(n) == 'friction']
        if own and axis not in records[0].untold:
            twin = _closest(records, twin, axis, own)
    return twin


def with_presliding(
    records: Sequence[Record], twin: TwinFile, effects: Effects, found: Mapping[str, float]
) -> TwinFile:
    """The twin, whose stated frictions build up over a presliding [m] that a balance found.

    `effects` are those beside them. The stated one stays where the loop comes no closer.
    """
    for name, presliding in found.items():
        axis = split_effect(name)[1] or ''
        own = {**twin.effects[name], PRESLIDING.name: presliding}
        bent = replace(twin, effects={**twin.effects, name: own})
        gaps = [
            fitted_gap(with_rests(records, run, effects, [axis]), run, effects, axis)
            for run in (twin, bent)
        ]
        twin = bent if gaps[1] < CLOSER * gaps[0] else twin
    return twin


def creep_notes(stated: TwinFile, run: TwinFile) -> list[str]:
    """What a reader has to know of frictions that give way in the twin as it is run."""
    return [
        f'{effect_words(name)}: at rest the friction of the machine gives way otherwise than '
        f'that of its twin. The twin with {way.name} {way.said(values[way.name])} follows '
        'it closer, and the effects are those beside it'
        for name, values in run.effects.items()
        for way in (CREEP, PRESLIDING)
        if values.get(way.name) != stated.effects[name].get(way.name)
    ]


def _closest(
    records: Sequence[Record], twin: TwinFile, axis: str, names: Sequence[str]
) -> TwinFile:
    """The twin with the frictions of an axis that follow the fitted ticks, if much closer."""

    def run(speed: float) -> TwinFile:
        own = {n: {**twin.effects[n], CREEP.name: speed} for n in names}
        return replace(twin, effects={**twin.effects, **own})

    best = run(_best(lambda speed: fitted_gap(records, run(speed), {}, axis, draws=1)))
    holds = fitted_gap(with_rests(records, twin, {}, [axis]), twin, {}, axis)
    return best if fitted_gap(records, best, {}, axis) < MUCH_CLOSER * holds else twin


def _best(left: Callable[[float], float]) -> float:
    """The speed that leaves least, between the neighbours of the best start."""
    start = min(CREEP.tried, key=left)
    ends = math.log(start / 3.0), math.log(3.0 * start)
    fit = minimize_scalar(
        lambda x: left(math.exp(x)), bounds=ends, method='bounded', options={'maxiter': 8}
    )
    return min(start, math.exp(fit.x), key=left)
