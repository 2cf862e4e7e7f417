"""Noise that the steps of an encoder hide: of which only a loop that sticks tells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from operator import is_

from gap_diagnosis.closed_loop import dither
from gap_diagnosis.closed_loop.replay import replayed_gap
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import fitted_ticks
from gap_diagnosis.parameters import Effects
from stage_core.twin_file import TwinFile

#: Noise that is tried, as a share of that of rounding. Shares of 0.1 to 0.5 left 0.33 to 0.55 µm of
#: a machine that crept through a rest of two seconds, none left 2.0 µm.
HIDDEN = 0.3
#: Share of the gap that is left with it where it is there.
CLOSER = 0.8


def with_hidden_noise(records: Sequence[Record], twin: TwinFile, effects: Effects) -> list[Record]:
    """The records, with such noise on the axes that the twin then follows closer.

    A friction holds an axis still that noise lets creep. Where the readings show the noise
    nothing is hidden, and without a friction it does nothing.
    """
    whole = list(records)
    sticking = twin.kind == 'servo' and dither.sticks({**twin.effects, **effects})
    for i, axis in enumerate(records[0].axes if sticking else ()):
        other = [_hidden(record, i) for record in whole]
        if axis in records[0].untold or all(map(is_, whole, other)):
            continue
        now, then = (
            replayed_gap(
                [r for r in some if not r.held_out_session],
                twin,
                effects,
                f'encoder.{axis}',
                fitted_ticks,
            )
            for some in (whole, other)
        )
        whole = other if then < CLOSER * now else whole
    return whole


def _hidden(record: Record, i: int) -> Record:
    """The record with noise below the steps of its i-th axis; itself if it has noise there."""
    own = None if record.noise is None else record.noise.axes[i]
    if record.noise is None or own is None or own.beyond_steps or own.hidden:
        return record
    small = replace(own, hidden=HIDDEN * own.quantum / math.sqrt(12.0))
    axes = (*record.noise.axes[:i], small, *record.noise.axes[i + 1 :])
    return replace(record, noise=replace(record.noise, axes=axes))
