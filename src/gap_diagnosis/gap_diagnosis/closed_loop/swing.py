"""A loop that swings: the twin with the effect swings as much as the record, at another phase.

A play before the encoder makes the loop swing, and no second run repeats the phase. Such an effect
cannot close the gap of the positions. It is judged by the force balance, and by how far the twin
with it strays from the twin without.
"""

from __future__ import annotations

import numpy as np

from gap_diagnosis.closed_loop.axis_loop import AxisLoop
from gap_diagnosis.closed_loop.replay import replay
from gap_diagnosis.input.windows import judging, scored_ticks
from gap_diagnosis.parameters import Effects

#: Factor by which the two swings may differ. With a right play the twin swings 0.50 to 1.02 times
#: as much as the record.
AS_MUCH = 2.5
#: Least share of the force balance's remainder that the effect explains: eleven right plays
#: explain 0.76 to 1.00, a wrong one 0.34 of the rest of a friction. One of 0.84, of a wave that
#: the encoder misreads, is kept out by `drive_play.SLOWEST`.
LEAST_SHARE = 0.7


def swings_as_much(name: str, effects: Effects, loop: AxisLoop) -> bool:
    """Whether the encoder strays as far in the twin with an effect as it does in the record."""
    rest = {n: v for n, v in effects.items() if n != name}
    recorded, own = [], []
    for record in judging(loop.records):
        mask = scored_ticks(record)
        without = replay(record, loop.twin, rest)[loop.channel][mask]
        recorded.append(without)
        own.append(without - replay(record, loop.twin, effects)[loop.channel][mask])
    ratio = float(np.linalg.norm(np.concatenate(own)) / np.linalg.norm(np.concatenate(recorded)))
    return 1.0 / AS_MUCH < ratio < AS_MUCH
