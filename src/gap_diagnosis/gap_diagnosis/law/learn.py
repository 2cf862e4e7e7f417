"""From what the named effects leave to laws of it, beside these effects or in their place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.closed_loop.channels import Channel, position_rms
from gap_diagnosis.closed_loop.replay import mean_square, replays
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import judging, scored_ticks
from gap_diagnosis.law.judged import Law, law_of
from gap_diagnosis.law.search import ABOUT_THE_SAME
from gap_diagnosis.law.signals import Signals, error_signals, force_signals
from gap_diagnosis.parameters import Effects
from gap_diagnosis.residuals.force_rows import ForceRows
from gap_diagnosis.residuals.kinematics import Kinematics
from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.selection.parts import LEAST_ROWS, Part
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.metrics import SIGMAS
from stage_core.twin_file import TwinFile
from stage_twin.effects.friction import DRY

Mask = NDArray[np.bool_]

#: Of its share of an axis' rows, what an effect of this axis alone may do to the other's.
ELSEWHERE = 1e-3


def learn(
    records: Sequence[Record],
    twin: TwinFile,
    parts: Sequence[Part],
    effects: Effects,
    channels: Mapping[str, Channel],
    seed: int,
) -> list[Law]:
    """Laws of what remains in each part with structure, largest shrinkage first.

    Parameters
    ----------
    effects : the named ones, as the corrected twin holds them
    channels : the gap with these
    """
    found = []
    for part in parts:
        if not part.structure.structured:
            continue
        for remainder in _remainders(part, records, effects):
            if np.count_nonzero(remainder.problem.fit) < LEAST_ROWS[0]:
                continue  # rests of a stepper

            def run(law: Law) -> tuple[float, float]:
                return _gap(law, records, twin, effects, channels)

            law = best(remainder, run, seed)
            if law is not None:
                found.append(law)
    return sorted(found, key=lambda law: -law.shrink)


@dataclass(frozen=True)
class Remainder:
    """What the named effects leave of one axis of a part, and the variables of its law.

    `named` holds what those effects that act here alone explain of the rows (n,).
    """

    problem: Problem
    signals: Signals
    axis: str
    named: dict[str, Array]


def best(remainder: Remainder, run: Callable[[Law], tuple[float, float]], seed: int) -> Law | None:
    """Of the laws beside the named effects and in their place the one that runs best.

    Of some that run about the same it is the first that leaves least of the rows.
    """
    laws = list(_tried(remainder, (), run, seed))
    if remainder.named:
        laws += _tried(remainder, tuple(remainder.named), run, seed)
    least = min((law.gap[1] for law in laws), default=0.0)
    near = [law for law in laws if ABOUT_THE_SAME * law.gap[1] <= least]
    least = min((law.after for law in near), default=0.0)
    return next((law for law in near if ABOUT_THE_SAME * law.after <= least), None)


def _tried(
    remainder: Remainder,
    instead: tuple[str, ...],
    run: Callable[[Law], tuple[float, float]],
    seed: int,
) -> Iterator[Law]:
    """The law in the place of some effects, with the drive's force at hand and without.

    In closed loop the drive follows what disturbs the axis, so that a law of its force may say
    no more than that it does.
    """
    own, signals = remainder.problem, remainder.signals
    problem = replace(own, target=own.target + sum(remainder.named[name] for name in instead))
    less = replace(signals, ticks={n: s for n, s in signals.ticks.items() if n != 'F'})
    for variables in (signals, less):
        law = law_of(problem, variables, remainder.axis, seed, own.target)
        for one in (law, law and firm(law)):
            if one is not None:
                one.instead = instead
                one.gap = run(one)
                yield one
        if 'F' not in signals.ticks or (law and law.kind == 'law' and 'F' not in law.range):
            return


def firm(law: Law) -> Law | None:
    """A law of a force whose friction holds firmly; None where the rows tell it from that.

    At a standstill the low-pass of the rows hides what the loop's run shows.
    """
    loose = [
        name
        for name, (reach, deviation, _) in law.parameters.items()
        if name.startswith('reach') and reach - SIGMAS * deviation < DRY < reach
    ]
    if law.unit != 'N' or not loose:
        return None
    # The parameters count the terms from one, the effect from zero.
    held = {f'reach{int(name.removeprefix("reach")) - 1}': DRY for name in loose}
    chosen = dict.fromkeys(loose, (DRY, 0.0, 'm'))
    return replace(law, parameters=law.parameters | chosen, values=law.values | held)


def _remainders(part: Part, records: Sequence[Record], effects: Effects) -> Iterator[Remainder]:
    """The remainder of each axis of a part with the variables of its law."""
    rows, fit = part.rows, part.selection.fit
    shares = {
        name: fit.contribution(part.problem, name)
        for name in part.selection.accepted
        if name in effects and name not in part.problem.before
    }
    if isinstance(rows, ForceRows):
        # The force that acts on the mass is the opposite of what the drive has to make.
        problem = replace(part.problem, target=-part.residual, terms={})
        named = {name: -share for name, share in shares.items()}
        yield Remainder(problem, force_signals(rows), rows.axis, named)
        return
    assert isinstance(rows, Kinematics)
    for i, axis in enumerate(rows.axes):
        if not any(r.moving[i] for r in records):
            continue
        own = part.row_axis == i
        named = {
            name: share[own]
            for name, share in shares.items()
            if np.sum(share[~own] ** 2) < ELSEWHERE * np.sum(share[own] ** 2)
        }
        problem = axis_problem(part.problem, part.residual, own)
        yield Remainder(problem, error_signals(rows, axis), axis, named)


def axis_problem(problem: Problem, target: Array, own: Mask) -> Problem:
    """The rows of one axis of the tracker's problem, without candidates."""
    names = ('fit', 'held_out', 'block', 'time', 'record')
    chosen = {name: getattr(problem, name)[own] for name in names}
    return replace(problem, target=target[own], terms={}, seams=None, before={}, **chosen)


def _gap(
    law: Law,
    records: Sequence[Record],
    twin: TwinFile,
    effects: Effects,
    channels: Mapping[str, Channel],
) -> tuple[float, float]:
    """RMS gap of all position channels with the named effects, and with the law beside them."""
    now, axis = position_rms(dict(channels), 'after'), law.channel[-1]
    if law.unit == 'm':
        name, gaps = f'tracker.{axis}', [np.full(1, law.after)]
        return now, _with(channels, name, gaps)
    name = f'encoder.{axis}'
    others = {n: v for n, v in effects.items() if n not in law.instead}
    try:
        runs = [
            (replays(r, twin, {**others, law.effect: law.values}), scored_ticks(r))
            for r in judging(records)
        ]
    except StageError:
        return now, float('inf')
    gaps = [np.sqrt(mean_square(own, name)[ticks]) for own, ticks in runs]
    return now, _with(channels, name, gaps)


def _with(channels: Mapping[str, Channel], name: str, gaps: list[Array]) -> float:
    """RMS gap of all position channels with other gaps of one of them."""
    other = replace(channels[name], after=gaps, drawn={})
    return position_rms({**channels, name: other}, 'after')
