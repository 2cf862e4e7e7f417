"""A loop that swings: the twin with the effect swings as much as the record, at another phase.

A play before the encoder makes the loop swing, and no second run repeats the phase. Such an effect
cannot close the gap of the positions. It is judged by the force balance, and by how far the twin
with it strays from the twin without.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from gap_diagnosis.closed_loop.axis_loop import AxisLoop
from gap_diagnosis.closed_loop.replay import replay
from gap_diagnosis.input.windows import judging, scored_ticks
from gap_diagnosis.parameters import Effects
from stage_core.arrays import Array
from stage_twin.effects import effect_of

#: What a swing's size hangs on most: with a play of a foreign contact the twin swung 0.23 times as
#: much as the record, and 0.96 times with half the damping that was found.
DAMPING = 'contact_damping'
#: Factor by which the two swings may differ. With a right play the twin swings 0.50 to 1.02 times
#: as much as the record.
AS_MUCH = 2.5
#: Least share of the force balance's remainder that an effect explains which the loop cannot
#: tell: a friction beside which it hunts, or one beside what no second run repeats.
LEAST_SHARE = 0.7


def swings_as_much(name: str, effects: Effects, loop: AxisLoop) -> bool:
    """Whether the encoder strays as far in the twin with an effect as it does in the record.

    How far a play throws hangs on the damping of its edges, which the force balance tells badly:
    it may be another one within its doubt.
    """
    known = {p.name: p for p in effect_of(name).parameters}.get(DAMPING)
    tried = [effects[name]]
    if known is not None:
        found = effects[name][DAMPING]
        other = [found * (1.0 - known.doubt), found * (1.0 + known.doubt)]
        inside = np.clip(other, known.minimum, known.maximum).tolist()
        tried += [{**effects[name], DAMPING: damping} for damping in inside]
    return any(1.0 / AS_MUCH < ratio < AS_MUCH for ratio in _ratios(name, effects, loop, tried))


def _ratios(
    name: str, effects: Effects, loop: AxisLoop, tried: Sequence[Mapping[str, float]]
) -> Iterator[float]:
    """The twin's swing over the record's, with each of some parameters of an effect."""
    rest = {n: v for n, v in effects.items() if n != name}
    recorded = _strays(rest, loop)
    for values in tried:
        own = recorded - _strays({**effects, name: values}, loop)
        yield float(np.linalg.norm(own) / np.linalg.norm(recorded))


def _strays(effects: Effects, loop: AxisLoop) -> Array:
    """Gap (n,) of the encoder on the rows that judge [m]."""
    gaps = [
        replay(record, loop.twin, effects)[loop.channel][scored_ticks(record)]
        for record in judging(loop.records)
    ]
    return np.concatenate(gaps)
