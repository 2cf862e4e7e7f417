"""The force balance of an axis beside the closed loop, which may contradict it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from gap_diagnosis.closed_loop.axis_loop import AxisLoop
from gap_diagnosis.closed_loop.dither import sticks
from gap_diagnosis.closed_loop.rests import with_rests
from gap_diagnosis.closed_loop.swing import LEAST_SHARE, swings_as_much
from gap_diagnosis.evidence.acceptance import FAR_BESIDE
from gap_diagnosis.evidence.describe import describe, model_of
from gap_diagnosis.parameters import Parameters
from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.servo import Servo
from gap_diagnosis.selection.lacking import with_lacking
from gap_diagnosis.selection.model import Selection
from gap_diagnosis.selection.model_errors import model_errors
from gap_diagnosis.selection.parts import SERVO_RULES, Part, fit_part, residual_of
from gap_diagnosis.selection.rivals import find_rivals
from gap_diagnosis.selection.swinging import swinging_part
from gap_diagnosis.selection.told import told_by_loop, told_where_it_slides
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile
from stage_twin.effects import effect_of
from stage_twin.effects.friction import PRESLIDING

#: Share of the loop's gap from which on a friction that is left makes it hunt: two right ones left
#: 0.66 and 0.76, those with which the loop follows the record 0.35 at most.
HUNTS = 0.5
#: Mean square over that of the noise, up to which an effect explains a balance although the loop
#: does not show it: three right delays with which it swings left 1.3 to 1.5 times the noise, a
#: friction for a brake of a part of the travel 7 times.
EXPLAINED = 2.0


def fit_servo(
    rows: Servo, problem: Problem, loop: AxisLoop, seed: int, without: Sequence[str]
) -> Part:
    """Force balance of an axis; an effect that the closed loop contradicts is taken out.

    A disturbance that nothing in the library explains is sometimes imitated in the force
    balance; the twin with such an effect then follows the record worse than without it.
    """
    barred = list(without)
    unconfirmed: tuple[str, ...] = ()
    presliding: dict[str, float] = {}
    while True:
        part = fit_part(f'servo.{loop.axis}', problem, SERVO_RULES, seed, barred)
        if loop.twin.kind != 'servo':
            find_rivals(part.selector, part.selection)
            return part
        if not unconfirmed:
            swung = swinging_part(part, rows, seed, barred)
            if swung is not None and _swings(swung, loop):
                return swung
        if not part.selection.accepted:
            part = with_lacking(part, loop)
        accepted = part.selection.accepted
        if not accepted:
            return replace(part, unconfirmed=unconfirmed, presliding=presliding)
        found = describe(part.selection, part.selector.regression)
        presliding.update(_presliding(found, loop.twin))
        # How the twin rests best hangs on what acts on it.
        rests = with_rests(loop.records, loop.twin, loop.with_known(found), [loop.axis])
        loop = replace(loop, records=rests)
        contradicted = _contradicted(accepted, found, loop)
        if contradicted and (swung := shaken(part, loop)).swinging:
            find_rivals(swung.selector, swung.selection)
            return replace(swung, unconfirmed=unconfirmed, presliding=presliding)
        if not contradicted:
            part = with_lacking(part, loop)
            found = describe(part.selection, part.selector.regression)
            presliding.update(_presliding(loop.refined(found), loop.twin))
            find_rivals(part.selector, part.selection)
            selection = told_by_loop(part, loop)
            told = partial(told_where_it_slides, part, selection, loop)
            errors = model_errors(part, selection, told)
            if errors:
                # What one of them follows closer in the loop is no better.
                replaced = [n for n in part.selection.accepted if n not in selection.accepted]
                barred += [*errors, *replaced]
                continue
            residual = residual_of(problem, selection)
            part = replace(part, selection=selection, residual=residual, unconfirmed=unconfirmed)
            return hunting(replace(part, presliding=presliding), loop)
        # Beside a loop that swings at another phase nothing else can be judged.
        swinging = [n for n in accepted if effect_of(n).swings]
        if len(contradicted) > 1 and swinging:
            contradicted = swinging
        unconfirmed += tuple(n for n in contradicted if n in swinging)
        barred += _to_bar(part.selection, contradicted)


def _to_bar(selection: Selection, contradicted: list[str]) -> list[str]:
    """Those of the contradicted effects that go; of a whole set all but the one that gains most.

    Beside others that are wrong it has wrong values. Without them the loop judges it anew.
    """
    if len(contradicted) < max(len(selection.accepted), 2):
        return contradicted
    main = max(contradicted, key=lambda n: selection.evidence[n].gain)
    return [n for n in contradicted if n != main]


def _presliding(found: Parameters, twin: TwinFile) -> dict[str, float]:
    """Preslidings [m] of the frictions that the twin states, as those found of their axis have."""
    told = {n: of[PRESLIDING.name][0] for n, of in found.items() if PRESLIDING.name in of}
    return {
        stated: value
        for name, value in told.items()
        for stated in twin.effects
        if sticks([stated]) and split_effect(stated)[1] == split_effect(name)[1]
    }


def hunting(part: Part, loop: AxisLoop) -> Part:
    """The part with a friction that makes the loop hunt among what swings.

    One that sticks and slips goes another way after each small change, so that the loop tells
    nothing of it. The balance does if it leaves noise alone, and the twin hunts as much.
    """
    frictions = [n for n in part.selection.accepted if model_of(n) == 'friction']
    return part if len(frictions) != 1 else _hunting(part, loop, *frictions)


def shaken(part: Part, loop: AxisLoop) -> Part:
    """The part with the one effect that explains the balance, and with which the loop swings.

    A long delay makes the loop swing, and no second run repeats the phase. So the loop contradicts
    the right delay, which the balance tells.
    """
    accepted = part.selection.accepted
    return _hunting(part, loop, *accepted) if len(accepted) == 1 else part


def _hunting(part: Part, loop: AxisLoop, name: str) -> Part:
    """The part with an effect among what swings, where the loop with it swings as the record.

    The balance has to be explained but for noise or the error of a model.
    """
    rest = part.selection.fit.mean_square(part.problem)
    error = part.selector.rules.of_gap * part.selector.gap
    if part.structure.structured or rest > max(EXPLAINED * part.selector.noise, error):
        return part
    effects = loop.with_known(loop.refined(describe(part.selection, part.selector.regression)))
    left = loop.gap(effects)
    without = loop.gap({n: v for n, v in effects.items() if n != name})
    hunts = left > max(FAR_BESIDE * loop.floor, HUNTS * without)
    clear = part.selection.evidence[name].share > LEAST_SHARE
    if hunts and clear and swings_as_much(name, effects, loop):
        return replace(part, swinging=(name,))
    return part


def _swings(part: Part, loop: AxisLoop) -> bool:
    """Whether the twin with the effect that swings does so as much as the record."""
    effects = loop.with_known(describe(part.selection, part.selector.regression))
    return all(swings_as_much(n, effects, loop) for n in part.swinging)


def _contradicted(accepted: list[str], found: Parameters, loop: AxisLoop) -> list[str]:
    """Effects with which the closed loop follows the held-out record worse than without.

    So it does with the parameters that were found, and with those that suit the loop, as few rows
    may tell an effect. What a stated friction does at rest contradicts nothing.
    """
    contradicted = _worse(accepted, found, loop)
    if contradicted:
        contradicted = _worse(accepted, loop.refined(found), loop)
    if contradicted and (told := loop.beside(accepted)).sliding:
        contradicted = _worse(accepted, found, told)
    return contradicted


def _worse(accepted: list[str], found: Parameters, loop: AxisLoop) -> list[str]:
    """The same for some parameters.

    Where the encoder's gap is large and all of them together close almost nothing of it, the
    force balance was imitated: all go but one that closes it alone. Below the encoder's step
    nothing is contradicted.
    """
    effects = loop.with_known(found)
    step = 12.0 * loop.floor**2
    nothing, everything = loop.gap({}) ** 2, loop.gap(effects) ** 2
    rest = {n: loop.gap({k: v for k, v in effects.items() if k != n}) ** 2 for n in accepted}
    best = min(accepted, key=lambda n: rest[n])
    if math.isinf(everything) or (nothing > 4.0 * step and everything > 0.7 * nothing):
        # One that is no machine beside the others may hide that they are right.
        clear = 0.7 * min(everything, nothing)
        if rest[best] < clear:
            return [best]
        kept = min(accepted, key=lambda n: loop.gap({n: effects[n]}))
        follows = loop.gap({kept: effects[kept]}) ** 2 < clear
        return [n for n in accepted if not (follows and n == kept)]
    loss = everything - rest[best]
    return [best] if loss > max(0.05 * everything, 0.05 * step) else []
