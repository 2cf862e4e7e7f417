"""Where an axis slides behind a friction that its twin states.

No two models of a friction agree within its presliding. Behind a friction that a twin states, the
machine has another one: after each reversal and at each rest the twin goes another way, which
says nothing of what it lacks. Such an axis counts where it slides.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.closed_loop.dither import sticks
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import judging, scored_ticks
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile

#: Time [s] for which a reference moves one way, at more than a share of its top speed, until an
#: axis counts as sliding. On 64 axes of three foreign simulators whose twins state a friction and
#: lack nothing the gap was up to 20 floors, and 1.8 where they slide so, 3.4 on one; on two that
#: lack a resonance it was 8.7 and 4.6, and 6.4 and 4.1 where they slide.
SLIDES, SLOW = 0.4, 0.02
#: Share of the ticks from which on the gap is told where an axis slides.
ENOUGH = 0.05


def slides(records: Sequence[Record], twin: TwinFile, axis: str) -> bool:
    """Whether an axis with a friction that the twin states slides long enough to be told by it."""
    stated = [n for n in twin.effects if split_effect(n)[1] == axis]
    if twin.kind != 'servo' or not sticks(stated):
        return False
    rows = [sliding(r, axis)[scored_ticks(r)] for r in judging(records)]
    return float(np.mean(np.concatenate(rows))) > ENOUGH


def sliding(record: Record, axis: str) -> NDArray[np.bool_]:
    """Ticks (n,) at which the reference has moved one way for `SLIDES`."""
    speed = np.nan_to_num(record.reference_velocity[:, record.column(axis)])
    way = np.sign(speed) * (np.abs(speed) > SLOW * np.abs(speed).max(initial=0.0))
    turns = np.flatnonzero(np.diff(way, prepend=0.0))
    began = np.concatenate([[0], turns])[np.searchsorted(turns, np.arange(len(way)), 'right')]
    return (way != 0.0) & (record.time - record.time[began] > SLIDES)
