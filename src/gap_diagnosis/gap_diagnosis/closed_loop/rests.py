"""How a twin is run where a friction holds an axis, so that it rests as the machine does.

The controller answers the noise of the encoder. Under it a friction lets the axis creep or holds
it, by what it does within its presliding: Dahl's model creeps, others do not (Al-Bender, Lampaert
and Swevers, "The generalized Maxwell-slip model: a novel model for friction simulation and
compensation", IEEE Transactions on Automatic Control 50, 2005). Noise below the steps of an
encoder shows in no reading. The twin is run in the way in which it follows the fitted ticks
closest.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

from gap_diagnosis.closed_loop import dither
from gap_diagnosis.closed_loop.replay import replayed_gap
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.noise import AxisNoise
from gap_diagnosis.input.windows import fitted_ticks
from gap_diagnosis.parameters import Effects
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile

#: Noise below the steps of an encoder, as a share of that of rounding. Shares of 0.1 to 0.5 left
#: 0.33 to 0.55 µm of a machine that crept through a rest of two seconds, none left 2.0 µm.
HIDDEN = 0.3
#: Share of the gap that another way leaves at most where it is the machine's. Such ways left 0.13,
#: 0.2, 0.59 and 0.67 of it on four machines of two foreign simulators.
CLOSER = 0.7


def with_rests(records: Sequence[Record], twin: TwinFile, effects: Effects) -> list[Record]:
    """The records, each axis with the noise and the presliding with which the twin rests alike."""
    whole = list(records)
    for i, axis in enumerate(records[0].axes):
        if whole[0].noise is None or axis in whole[0].untold:
            continue
        ways = [[_run(r, i, *way) for r in whole] for way in _ways(records[0], i, twin, effects)]
        if len(ways) > 1:
            gaps = [_gap(way, twin, effects, axis) for way in ways]
            best = gaps.index(min(gaps))
            whole = ways[best] if gaps[best] < CLOSER * gaps[0] else ways[0]
    return whole


def rest_notes(record: Record) -> list[str]:
    """What a reader has to know of axes whose twin is not run as its file says."""
    if record.noise is None:
        return []
    notes: list[str] = []
    for axis, own in zip(record.axes, record.noise.axes, strict=True):
        if own.at_rest:
            notes.append(
                f'axis {axis}: noise that the steps of the encoder hide lets the machine creep at '
                f'rest; its twin is run with {1e9 * own.at_rest:.2g} nm of it'
            )
        elif own.at_rest == 0.0:
            notes.append(
                f'axis {axis}: at rest the noise of the encoder moves the machine less than its '
                'twin, which is run without that noise'
            )
        if own.dry:
            notes.append(
                f'axis {axis}: the machine rests as with a dry friction; the twin is run without '
                'the presliding that it states, set it to 0'
            )
    return notes


def _ways(
    record: Record, i: int, twin: TwinFile, effects: Effects
) -> list[tuple[float | None, bool]]:
    """Noise [m] (None: as measured) and dryness of the twin's friction; the usual way first."""
    axis = record.axes[i]
    sticking = [n for n in (*twin.effects, *effects) if split_effect(n)[1] == axis]
    if twin.kind != 'servo' or not dither.sticks(sticking) or record.noise is None:
        return []
    own = record.noise.axes[i]
    other = 0.0 if own.beyond_steps else HIDDEN * own.quantum / math.sqrt(12.0)
    stated = [n for n in sticking if n in twin.effects and n not in effects]
    dry = (False, True) if dither.sticks(stated) else (False,)
    return list(itertools.product((None, other), dry))


def _run(record: Record, i: int, noise: float | None, dry: bool) -> Record:
    assert record.noise is not None

    def own(axis: AxisNoise) -> AxisNoise:
        return replace(axis, at_rest=noise, dry=dry)

    axes = tuple(own(a) if k == i else a for k, a in enumerate(record.noise.axes))
    return replace(record, noise=replace(record.noise, axes=axes))


def _gap(records: list[Record], twin: TwinFile, effects: Effects, axis: str) -> float:
    fitted = [record for record in records if not record.held_out_session]
    return replayed_gap(fitted, twin, effects, f'encoder.{axis}', fitted_ticks)
