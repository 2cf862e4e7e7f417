"""Stated frictions that give way at rest as those of the machine do.

A friction gives way over a presliding, or it is a smooth function of the speed, which lets an axis
creep under the least force. A twin whose friction holds then rests at other places. Where one that
gives way otherwise follows the fitted ticks much closer, the twin is run with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from scipy.optimize import minimize_scalar

from gap_diagnosis.closed_loop.replay import DRAWS, replayed_gap
from gap_diagnosis.closed_loop.rests import with_rests
from gap_diagnosis.evidence.describe import model_of
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import fitted_ticks
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile
from stage_core.wording import effect_words
from stage_twin.effects import effect_of

#: How a friction may give way, and where a search starts [m, m/s]: below it creeps by less than
#: the step of an encoder.
WAYS = {
    'presliding': (3e-7, 1e-6, 3e-6, 1e-5),
    'creep_velocity': (1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3),
}
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


def creep_notes(stated: TwinFile, run: TwinFile) -> list[str]:
    """What a reader has to know of frictions that give way in the twin as it is run."""
    return [
        f'{effect_words(name)}: at rest the friction of the machine gives way otherwise than '
        f'that of its twin, which is run with {key} {known.parameter(key).said(values[key])}'
        for name, values in run.effects.items()
        for key, known in ((key, effect_of(name)) for key in WAYS)
        if values.get(key) != stated.effects[name].get(key)
    ]


def _closest(
    records: Sequence[Record], twin: TwinFile, axis: str, names: Sequence[str]
) -> TwinFile:
    """The twin with the frictions of an axis that follow the fitted ticks, if much closer."""

    def run(way: str, size: float) -> TwinFile:
        own = {n: {**twin.effects[n], way: size} for n in names}
        return replace(twin, effects={**twin.effects, **own})

    def left(way: str, size: float) -> float:
        return _gap(records, run(way, size), axis, draws=1)

    ways = [run(way, _best(partial(left, way), sizes)) for way, sizes in WAYS.items()]
    best = min(ways, key=lambda own: _gap(records, own, axis))
    holds = _gap(with_rests(records, twin, {}, [axis]), twin, axis)
    return best if _gap(records, best, axis) < MUCH_CLOSER * holds else twin


def _best(left: Callable[[float], float], starts: Sequence[float]) -> float:
    """The size that leaves least, between the neighbours of the best start."""
    start = min(starts, key=left)
    ends = math.log(start / 3.0), math.log(3.0 * start)
    fit = minimize_scalar(
        lambda x: left(math.exp(x)), bounds=ends, method='bounded', options={'maxiter': 8}
    )
    return min(start, math.exp(fit.x), key=left)


def _gap(records: Sequence[Record], twin: TwinFile, axis: str, draws: int = DRAWS) -> float:
    fitted = [record for record in records if not record.held_out_session]
    return replayed_gap(fitted, twin, {}, f'encoder.{axis}', fitted_ticks, draws)
