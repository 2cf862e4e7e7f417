"""What a pass of the diagnosis leaves out of the next one."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gap_diagnosis.closed_loop.misread import misread
from gap_diagnosis.evidence import judgement as judge
from gap_diagnosis.evidence.acceptance import shrink_of
from gap_diagnosis.passes import Prepared
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.selection.parts import Part
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile
from stage_twin.effects import effect_of, link_of

#: Mean square that effects leave of a force balance, over what others left that the loop refuted,
#: from which on they are an excuse. On 336 foreign sessions wrong ones left 4.3, 12 and 61 times
#: as much, right ones 2.7 times at most.
FAR_MORE = 3.5
#: Probability from which on an effect is named beside an `unknown`: it is rather there than not.
LIKELY = 0.5


def left_out(
    result: Diagnosis, prepared: Prepared, least: dict[str, float], seed: int
) -> tuple[list[str], str]:
    """Effects that the next pass does without, and why; none where this one stands.

    `least` is what the passes left of each force balance (:func:`explained_better`).
    """
    better = explained_better(result.parts, least)
    failed = [c for c in result.causes if c.refuted]
    beside = _excluded_by_tracker(result) or _misread_wave(result, prepared)
    if beside or failed:
        out = [beside] if beside else _first_out(result, failed, prepared.seen, seed)
        return out, f'left out, as the twin that is run does not show it: {", ".join(out)}'
    if doubted := _doubted(result):
        return doubted, f'left out, as it is rather not there: {", ".join(doubted)}'
    return better, 'left out: what was left out before explained far more of the balance'


def _first_out(
    result: Diagnosis, failed: list[judge.Cause], seen: TwinFile, seed: int
) -> list[str]:
    """The refuted effect that shrinks the gap least, or all of its axis that nothing needs.

    These are the servo effects of an axis if each of them is refuted, and all together close
    nothing either. Two that stand for one another are refuted, too, but not together.
    """
    worst = min(failed, key=lambda c: c.interval[0]).effect
    axis = split_effect(worst)[1]
    own = [n for n in result.accepted if link_of(n) == 'servo' and split_effect(n)[1] == axis]
    if worst not in own or not set(own) <= {c.effect for c in failed}:
        return [worst]
    sides = {
        n: c.sides(judge.channel_floor(seen, n))
        for n, c in result.channels.items()
        if n in (f'encoder.{axis}', f'force.{axis}')
    }
    # Of a machine that is seen by a tracker alone no channel of the axis says anything.
    return [worst] if not sides or shrink_of(worst, sides, seed).matters else own


def _doubted(result: Diagnosis) -> list[str]:
    """Names beside an `unknown` that are rather not there.

    Those with alternatives go where their own balance holds the unknown remainder: what nobody
    knows may replace them, too. Four of four on eight seeds of foreign simulators were wrong. Else
    the least likely one without alternatives goes, if it is below `LIKELY`.
    """
    if not result.structured:
        return []
    named = [c for c in result.causes if c.effect in result.accepted]
    parts = {n for p in result.parts if p.structure.structured for n in p.selection.accepted}
    replaced = [c.effect for c in named if c.alternatives and c.effect in parts]
    alone = [c for c in named if not c.alternatives and c.probability < LIKELY]
    return replaced or [c.effect for c in sorted(alone, key=lambda c: c.probability)[:1]]


def _excluded_by_tracker(result: Diagnosis) -> str | None:
    """A servo effect that excludes another one of its axis, which the tracker shows."""
    shown = {n for p in result.parts if p.name == 'tracker' for n in p.selection.accepted}
    for name in result.accepted:
        effect, axis = split_effect(name)
        rivals = {f'{other}.{axis}' for other in effect_of(effect).excludes}
        if name not in shown and rivals & shown:
            return name
    return None


def _misread_wave(result: Diagnosis, prepared: Prepared) -> str | None:
    """A wave of the table that is what the encoder reads."""
    floors = {n: judge.channel_floor(prepared.seen, n) for n in result.channels}
    run = {n: v for n, v in result.parameters.items() if n not in result.unrepeated}
    return misread(result.records, result.twin, run, result.channels, floors)


def explained_better(parts: Sequence[Part], least: dict[str, float]) -> list[str]:
    """Servo effects of the axes whose force balance an earlier pass explained far better.

    What that pass named the loop has refuted; but no other effect is the right one, either, that
    explains far less. These are all that such a balance could name. `least` is the least mean
    square that the passes left of each balance, by its name; it is brought up to date. What would
    matter of no effect (`Rules.of_gap`) is not far.
    """
    names: list[str] = []
    for part in (p for p in parts if p.name.startswith('servo')):
        left = max(part.structure.mean_square, part.problem.floor**2)
        before = least.get(part.name, math.inf)
        matters = part.selector.rules.of_gap * part.selector.gap
        if part.selection.accepted and left > max(FAR_MORE * before, before + matters):
            names += part.problem.terms
        least[part.name] = min(left, before)
    return names
