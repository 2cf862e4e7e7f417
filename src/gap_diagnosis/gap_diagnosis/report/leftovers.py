"""The largest of what the corrected twin leaves: when it happens, and beside what."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import judging
from gap_diagnosis.result import Diagnosis
from stage_core.arrays import Array

#: A leftover beyond so many robust standard deviations is an event. Of a million samples of
#: normal noise, one exceeds five.
EVENT = 6.0
#: Events nearer to each other than this (s) are one.
APART = 0.2
#: An event so soon after a reversal of the axis (s) goes with it.
AFTER_REVERSAL = 0.3
MOST = 3


@dataclass(frozen=True)
class Leftover:
    """Events of one channel: how many, how large, when (s), and how many follow a reversal."""

    channel: str
    count: int
    largest: float
    times: list[float]
    after_reversal: int
    unit: str


def leftovers(diagnosis: Diagnosis) -> list[Leftover]:
    """Events that stand out of what the corrected twin leaves, of every position channel."""
    found, scored = [], judging(diagnosis.records)
    counts = {
        f'encoder.{name}': getattr(axis, 'encoder_resolution', 0.0)
        for name, axis in diagnosis.twin.axes.items()
    }
    for channel in diagnosis.channels.values():
        if channel.unit != 'm':
            continue
        events: list[tuple[float, float, bool]] = []
        for record, time, after in zip(
            scored[-len(channel.time) :], channel.time, channel.after, strict=True
        ):
            reversals = _reversals(record, channel.name[-1])
            for at, size in _events(time, after):
                if size < 1.5 * counts.get(channel.name, 0.0):
                    continue  # one count of the encoder
                before = at - reversals
                events.append((size, at, bool(((before >= 0) & (before < AFTER_REVERSAL)).any())))
        if events:
            events.sort(reverse=True)
            found.append(
                Leftover(
                    channel.name,
                    len(events),
                    events[0][0],
                    [at for _, at, _ in events[:MOST]],
                    sum(reversed_ for _, _, reversed_ in events),
                    channel.unit,
                )
            )
    return found


def _events(time: Array, values: Array) -> list[tuple[float, float]]:
    """Time and size of every event, the largest sample of each."""
    # Where most samples are equal (encoder counts), the mean square bounds the scale from below.
    scale = max(1.4826 * float(np.median(np.abs(values))), 0.3 * float(values.std()))
    high = np.flatnonzero(np.abs(values) > EVENT * scale)
    if not len(high):
        return []
    groups = np.split(high, np.flatnonzero(np.diff(time[high]) > APART) + 1)
    peaks = (g[np.argmax(np.abs(values[g]))] for g in groups)
    return [(float(time[p]), float(abs(values[p]))) for p in peaks]


def _reversals(record: Record, axis: str) -> Array:
    """Times (s) at which the reference of an axis starts another way than it last went."""
    if axis not in record.axes:
        return np.empty(0)
    speed = np.diff(record.reference[:, record.axes.index(axis)])
    moving = np.flatnonzero(np.abs(speed) > 1e-9)
    turns = moving[1:][np.diff(np.sign(speed[moving])) != 0]
    return record.time[turns]
