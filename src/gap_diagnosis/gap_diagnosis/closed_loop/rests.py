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
from gap_diagnosis.closed_loop.replay import fitted_gap
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.noise import AxisNoise
from gap_diagnosis.parameters import Effects
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile

#: Noise below the steps of an encoder, as a share of that of rounding. Shares of 0.1 to 0.5 left
#: 0.33 to 0.55 µm of a machine that crept through a rest of two seconds, none left 2.0 µm.
HIDDEN = 0.3
#: Share of the gap that another way leaves at most where it is the machine's. Such ways left 0.13,
#: 0.2, 0.59 and 0.67 of it on four machines of two foreign simulators.
CLOSER = 0.7


def with_rests(
    records: Sequence[Record], twin: TwinFile, effects: Effects, axes: Sequence[str] | None = None
) -> list[Record]:
    """The records with the noise and the presliding with which the twin's `axes` (all) rest alike.

    An axis without a friction is run as usual.
    """
    whole = list(records)
    for i, axis in enumerate(records[0].axes):
        noises = [r.noise.axes[i] for r in whole if r.noise is not None]
        if axis in whole[0].untold or not noises or (axes is not None and axis not in axes):
            continue
        shown = any(noise.beyond_steps for noise in noises)
        ways = [[_run(r, i, shown, *way) for r in whole] for way in _ways(axis, twin, effects)]
        best = 0
        if len(ways) > 1:
            gaps = [fitted_gap(way, twin, effects, axis) for way in ways]
            best = gaps.index(min(gaps))
            best = best if gaps[best] < CLOSER * gaps[0] else 0
        whole = ways[best]
    return whole


def with_hidden(record: Record) -> Record:
    """The record with noise that steps hide, on axes that show none and are run with none."""
    if record.noise is None:
        return record
    axes = tuple(
        own if own.beyond_steps or own.at_rest is not None else replace(own, at_rest=_hidden(own))
        for own in record.noise.axes
    )
    return replace(record, noise=replace(record.noise, axes=axes))


def undried(record: Record) -> Record:
    """The record, beside which the frictions that its twin states keep their presliding."""
    if record.noise is None:
        return record
    axes = tuple(replace(own, dry=False) for own in record.noise.axes)
    return replace(record, noise=replace(record.noise, axes=axes))


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


def _ways(axis: str, twin: TwinFile, effects: Effects) -> list[tuple[bool, bool]]:
    """Whether an axis has another noise, and a dry friction; the usual way first."""
    sticking = [n for n in (*twin.effects, *effects) if split_effect(n)[1] == axis]
    if twin.kind != 'servo' or not dither.sticks(sticking):
        return [(False, False)]
    stated = [n for n in sticking if n in twin.effects and n not in effects]
    dry = (False, True) if dither.sticks(stated) else (False,)
    return list(itertools.product((False, True), dry))


def _run(record: Record, i: int, shown: bool, other: bool, dry: bool) -> Record:
    """The record with the measured noise of an axis, or the `other` one, and a dry friction.

    The other one is none where sessions have `shown` noise beyond the steps of the encoder.
    """
    if record.noise is None:
        return record
    axes = list(record.noise.axes)
    own = axes[i]
    hidden = 0.0 if shown else _hidden(own)
    axes[i] = replace(own, at_rest=hidden if other else None, dry=dry)
    return replace(record, noise=replace(record.noise, axes=tuple(axes)))


def _hidden(noise: AxisNoise) -> float:
    """Noise [m] that the steps of an encoder may hide."""
    return HIDDEN * noise.quantum / math.sqrt(12.0)
