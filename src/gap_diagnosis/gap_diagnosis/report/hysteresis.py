"""Hysteresis of the gap: force after a reversal, position error by the direction of motion."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from gap_diagnosis.closed_loop.channels import Channel
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import judging
from gap_diagnosis.report.figures import AFTER, BEFORE, scale
from gap_diagnosis.result import Diagnosis
from stage_core.arrays import Array
from stage_core.drawing import legend_above, paired, plain, styled
from stage_core.theme import INK
from stage_core.wording import effect_words

#: An axis has reversed when it has come back by this (m), a few counts of an encoder: less is
#: noise.
TURN = 3e-6
#: Travel after a reversal (m) over which the force is averaged: friction builds up within it.
TRAVEL = np.concatenate([[0.0], np.geomspace(2e-6, 2e-3, 22)])
#: Stretches of the travel over which the position error is averaged.
STRETCHES = 12
#: Fewest samples of a mean that is drawn.
SAMPLES = 5


def since_reversal(position: Array, threshold: float = TURN) -> tuple[Array, Array]:
    """Travel (n,) [m] since the last reversal, and the direction (n,) of motion after it.

    The direction is 0 before the axis has moved by `threshold` [m].
    """
    travel, direction = np.zeros(len(position)), np.zeros(len(position))
    turn = extreme = float(position[0])
    way = 0.0
    for tick, value in enumerate(position.tolist()):
        if way == 0.0 and abs(value - turn) > threshold:
            way, extreme = float(np.sign(value - turn)), value
        elif way * (value - extreme) > 0.0:
            extreme = value
        elif way and way * (extreme - value) > threshold:
            turn, extreme, way = extreme, value, -way
        travel[tick], direction[tick] = abs(value - turn), way
    return travel, direction


@dataclass(frozen=True)
class Hysteresis:
    """Mean gap of a channel in both directions; arrays (2, k), NaN where there are no samples.

    `place` (k,) [m] is the travel since the last reversal for a force, the position for a
    tracker. The first row belongs to motion towards larger positions.
    """

    channel: Channel
    place: Array
    before: Array
    after: Array


def hysteresis(diagnosis: Diagnosis) -> list[Hysteresis]:
    """The force and the tracker channels of every axis that turns back."""
    scored = judging(diagnosis.records)
    found = []
    for channel in diagnosis.channels.values():
        kind, _, axis = channel.name.partition('.')
        if kind not in ('force', 'tracker') or len(scored) != len(channel.time):
            continue
        pieces = [_motion(r, axis, t) for r, t in zip(scored, channel.time, strict=True)]
        position, travel, direction = (np.concatenate(part) for part in zip(*pieces, strict=True))
        place = travel if kind == 'force' else position
        ends = np.linspace(position.min(), position.max(), STRETCHES + 1)
        edges = TRAVEL if kind == 'force' else ends
        before, after = (
            np.stack([_means(place, gap, direction == way, edges) for way in (1.0, -1.0)])
            for gap in (np.concatenate(channel.before), np.concatenate(channel.after))
        )
        if np.isfinite(before).sum(axis=1).min() >= 3:
            middle = np.array([0.5 * (a + b) for a, b in pairwise(edges)])
            found.append(Hysteresis(channel, middle, before, after))
    return found


def _motion(record: Record, axis: str, time: Array) -> tuple[Array, Array, Array]:
    """Position, travel since the reversal and direction at the given times (n,) [s]."""
    position = record.encoder[:, record.column(axis)]
    travel, direction = since_reversal(position)
    index = np.clip(np.searchsorted(record.time, time), 0, len(record.time) - 1)
    return position[index], travel[index], direction[index]


def _means(place: Array, gap: Array, chosen: NDArray[np.bool_], edges: Array) -> Array:
    """Mean gap (k,) of the chosen samples between the edges (k + 1,); NaN for too few."""
    bins = len(edges) - 1
    number = np.digitize(place, edges) - 1
    chosen = chosen & (number < bins)
    counts = np.bincount(number[chosen], minlength=bins)
    sums = np.bincount(number[chosen], gap[chosen], minlength=bins)
    return np.where(counts >= SAMPLES, sums / np.maximum(counts, 1), np.nan)


@styled
def hysteresis_plot(found: list[Hysteresis]) -> Figure:
    """Mean gap in both directions, one panel a channel: filled forwards, open backwards."""
    figure, panels = paired(len(found), 2.7)
    for plot, item in zip(panels, found, strict=True):
        factor, unit = scale(item.channel)
        force = unit == 'N'
        plot.axhline(0.0, color=INK, lw=0.7)
        for gap, style in ((item.before, BEFORE), (item.after, AFTER)):
            for row, filled in zip(gap, (True, False), strict=True):
                seen = np.isfinite(row)
                plot.plot(
                    (1e6 if force else 1e3) * item.place[seen],
                    factor * row[seen],
                    marker='o',
                    ms=4,
                    mfc=style['color'] if filled else 'none',
                    **{**style, 'label': f'{style["label"]}, {"+" if filled else "−"}'},
                )
        if force:
            plot.set_xscale('log')
            plain(plot.xaxis)
        axis = item.channel.name[-1]
        plot.set_xlabel('travel since the reversal (µm)' if force else f'{axis} (mm)')
        plot.set_ylabel(f'{effect_words(item.channel.name)} ({unit})')
    legend_above(figure, panels[0], 2)
    return figure
