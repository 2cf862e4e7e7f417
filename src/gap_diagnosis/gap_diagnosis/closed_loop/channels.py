"""Channels of the gap: before, after, and without one cause, on the held-out rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.closed_loop.replay import mean_square, replay, replays
from gap_diagnosis.closed_loop.rests import undried, with_hidden
from gap_diagnosis.evidence import judgement as judge
from gap_diagnosis.evidence.acceptance import FAR, Sides
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import STARTED, judging, scored_ticks
from gap_diagnosis.selection.parts import Part
from stage_core.arrays import Array
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile
from stage_twin.effects import EFFECTS, misreads


@dataclass
class Channel:
    """One channel on the held-out rows.

    Attributes
    ----------
    time : of each record [s]
    before, after : gap of each record without the effects and with them, of one draw of the noise
    drawn : squares of both (`before` and `after`), mean over several draws, where there are some
    """

    name: str
    unit: str
    time: list[Array]
    before: list[Array]
    after: list[Array]
    drawn: dict[str, list[Array]] = field(default_factory=dict)

    def squares(self, which: str) -> list[Array]:
        """Squared gap of each record, `before` or `after`."""
        return self.drawn.get(which) or [gap**2 for gap in getattr(self, which)]

    def rms(self, which: str) -> float:
        """Root mean square over the held-out rows of all records."""
        return float(np.sqrt(np.mean(np.concatenate(self.squares(which)))))

    def sides(
        self,
        floor: float,
        without: list[Array] | None = None,
        rows: list[NDArray[np.bool_]] | None = None,
    ) -> Sides:
        """Its squares with all effects, and those without some, by default without any.

        Of the held-out rows some `rows` of each record count, by default all.
        """
        nominal = self.squares('before')
        without_it, with_it, nominal_gap = (
            np.concatenate(squares if rows is None else _picked(squares, rows))
            for squares in (
                nominal if without is None else without,
                self.squares('after'),
                nominal,
            )
        )
        return Sides(without_it, with_it, self.unit, floor, float(np.mean(nominal_gap)))


def _picked(squares: list[Array], rows: list[NDArray[np.bool_]]) -> list[Array]:
    return [own[kept] for own, kept in zip(squares, rows, strict=True)]


def _in_session(
    record: Record,
    records: list[Record],
    effects: dict[str, dict[str, float]],
    parts: list[Part],
) -> dict[str, dict[str, float]]:
    """The effects with the nuisances (a phase) of one held-out session."""
    number = next(i for i, other in enumerate(records) if other is record)
    out = {n: dict(v) for n, v in effects.items()}
    for part in parts:
        for name, coefficients in part.selection.fit.sessions.get(number, {}).items():
            theta = part.selection.fit.thetas[name]
            values = part.problem.terms[name].parameters(theta, coefficients)
            for parameter in EFFECTS[split_effect(name)[0]].parameters:
                if parameter.nuisance and name in out and parameter.name in values:
                    out[name][parameter.name] = values[parameter.name]
    return out


def gap_channels(
    records: list[Record],
    twin: TwinFile,
    effects: dict[str, dict[str, float]],
    parts: list[Part],
) -> dict[str, Channel]:
    """Every channel on the held-out rows: nominal twin before, corrected twin after."""
    scored = judging(records)
    channels: dict[str, Channel] = {}
    for record in scored:
        own = _in_session(record, records, effects, parts)
        before, after = (replays(record, twin, some) for some in ({}, own))
        mask = scored_ticks(record)
        for name in before[0]:
            unit = 'N' if name.startswith('force') else 'm'
            channel = channels.setdefault(name, Channel(name, unit, [], [], []))
            channel.time.append(record.time[mask])
            for which, runs in (('before', before), ('after', after)):
                getattr(channel, which).append(runs[0][name][mask])
                channel.drawn.setdefault(which, []).append(mean_square(runs, name)[mask])
    for part in parts:
        if part.name != 'tracker':
            continue
        at = 0
        for record in records:
            assert record.tracker_time is not None
            count = len(record.tracker_time)
            for axis in record.axes:
                rows = slice(at, at + count)
                at += count
                if not any(record is other for other in scored):
                    continue
                mask = part.problem.held_out[rows]
                name = f'tracker.{axis}'
                channel = channels.setdefault(name, Channel(name, 'm', [], [], []))
                channel.time.append(record.tracker_time[mask])
                channel.before.append(part.problem.gap[rows][mask])
                channel.after.append(part.residual[rows][mask])
    return channels


def as_stated(
    channels: dict[str, Channel], records: list[Record], stated: TwinFile
) -> dict[str, Channel]:
    """The channels with the gap before of the twin as its file states it.

    How a friction holds or gives way at rest may be otherwise in the twin that the effects are
    judged beside.
    """
    runs = [(replays(undried(r), stated, {}), scored_ticks(r)) for r in judging(records)]
    out = dict(channels)
    for name in runs[0][0][0]:
        before = [own[0][name][mask] for own, mask in runs]
        squares = [mean_square(own, name)[mask] for own, mask in runs]
        drawn = {**channels[name].drawn, 'before': squares}
        out[name] = replace(channels[name], before=before, drawn=drawn)
    return out


def noise_notes(
    records: list[Record],
    twin: TwinFile,
    effects: dict[str, dict[str, float]],
    channels: dict[str, Channel],
) -> list[str]:
    """What a reader has to know of a twin that follows the machine with its noise alone."""
    notes: list[str] = []
    for channel in [c for c in channels.values() if c.name.startswith('encoder')]:
        gaps = [
            replay(r, twin, effects, draw=None)[channel.name][scored_ticks(r)]
            for r in judging(records)
        ]
        alone, after = float(np.sqrt(np.mean(np.concatenate(gaps) ** 2))), channel.rms('after')
        if alone > FAR * after:
            axis = split_effect(channel.name)[1]
            notes.append(
                f'axis {axis}: the noise of the encoder shakes it out of its friction. A run of '
                f'the corrected twin without that noise sticks, and misses the record by '
                f'{1e6 * alone:.2g} µm RMS instead of {1e6 * after:.2g} µm'
            )
    return notes


def position_rms(channels: dict[str, Channel], which: str) -> float:
    """Root mean over the position channels of each channel's squared RMS [m]."""
    squares = [c.rms(which) ** 2 for c in channels.values() if c.unit == 'm']
    return float(np.sqrt(np.mean(squares)))


def session_rms(
    records: list[Record],
    twin: TwinFile,
    effects: dict[str, dict[str, float]],
    axes: Sequence[str],
    ticks: Sequence[NDArray[np.bool_]] | None = None,
) -> tuple[float, float]:
    """RMS [m] of the encoders' gap over whole sessions, without effects and with them.

    A gap that opens in the fitted windows alone is no gap of the held-out ones. Of each session
    some `ticks` (n,) count, by default all.
    """
    squares: tuple[list[float], list[float]] = [], []
    for k, record in enumerate(records):
        rows = (record.time > STARTED) & record.whole(record.time)
        rows &= True if ticks is None else ticks[k]
        if not np.any(rows):
            continue
        for which, some in zip(squares, ({}, effects), strict=True):
            gaps = replay(record, twin, some)
            own = [gaps[f'encoder.{a}'] for a in axes if f'encoder.{a}' in gaps]
            which += [float(np.mean(gap[rows] ** 2)) for gap in own]
    before, after = (float(np.sqrt(np.mean(which or [0.0]))) for which in squares)
    return before, after


def chance_rms(
    records: list[Record],
    twin: TwinFile,
    effects: dict[str, dict[str, float]],
    axes: Sequence[str],
) -> float:
    """RMS [m] by which the encoders of two runs of a twin differ whose noise differs.

    Zero without a friction. A machine that sticks differs from its own right twin by as much, also
    by noise that the steps of its encoder hide.
    """
    squares = [0.0]
    for record in map(with_hidden, records):
        rows = (record.time > STARTED) & record.whole(record.time)
        one, other = (replay(record, twin, effects, draw) for draw in (0, 1))
        names = [f'encoder.{axis}' for axis in axes if f'encoder.{axis}' in one]
        squares += [float(np.mean((one[n] - other[n])[rows] ** 2)) for n in names]
    return float(np.sqrt(np.sum(squares) / max(len(squares) - 1, 1)))


def without_cause(
    name: str,
    rest: dict[str, dict[str, float]],
    scored: list[Record],
    twin: TwinFile,
    parts: list[Part],
    channels: dict[str, Channel],
) -> dict[str, list[Array]]:
    """Squared gap of every channel with one cause taken out of the corrected twin, not refitted.

    `parts` are those that show the cause: an axis, the tracker, both, or none where it was read
    from the record itself.
    """
    gaps = {c.name: list(c.after) for c in channels.values()}
    for part in parts:
        if part.name == 'tracker':
            _give_back(name, part, scored[0].axes, gaps)
    out = {
        c.name: list(c.squares('after')) if c.drawn else [gap**2 for gap in gaps[c.name]]
        for c in channels.values()
    }
    if [part.name for part in parts] == ['tracker'] and not misreads(name):
        return out  # the loop knows nothing of it
    for j, record in enumerate(scored):
        runs = replays(record, twin, rest)
        mask = scored_ticks(record)
        for channel in runs[0]:
            out[channel][j] = mean_square(runs, channel)[mask]
    return out


def _give_back(name: str, part: Part, axes: tuple[str, ...], gaps: dict[str, list[Array]]) -> None:
    """Put what a cause explains of the tracker back into its channels."""
    contribution = part.selection.fit.contribution(part.problem, name)
    contribution = contribution + part.problem.before.get(name, 0.0)
    for i, axis in enumerate(axes):
        channel = f'tracker.{axis}'
        if channel not in gaps:
            continue
        values = contribution[part.problem.held_out & (part.row_axis == i)]
        at = 0
        for j, after in enumerate(gaps[channel]):
            gaps[channel][j] = after + values[at : at + len(after)]
            at += len(after)


def axis_shares(
    axes: tuple[str, ...], channels: dict[str, Channel], twin: TwinFile
) -> tuple[dict[str, float], str]:
    """Share of each axis in the gap above the floor, and the link with the largest gap."""
    excess = {}
    for channel in channels.values():
        if channel.unit == 'm':
            floor = judge.channel_floor(twin, channel.name)
            excess[channel.name] = max(channel.rms('before') ** 2 - floor**2, 0.0)
    total = sum(excess.values()) or 1.0
    shares = {a: sum(v for n, v in excess.items() if n.endswith(f'.{a}')) / total for a in axes}
    worst = max(excess, key=lambda n: excess[n])
    return shares, 'servo' if worst.startswith('encoder') else 'kinematic'
