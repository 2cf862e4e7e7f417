"""One accepted effect: what the gap is without it, and whether the twin as it is run shows it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gap_diagnosis.closed_loop.channels import Channel, without_cause
from gap_diagnosis.closed_loop.dither import sticks
from gap_diagnosis.closed_loop.swing import LEAST_SHARE
from gap_diagnosis.closed_loop.unexplained import Sliding
from gap_diagnosis.evidence import judgement as judge
from gap_diagnosis.evidence.acceptance import (
    LEAST_SHRINK,
    Shrink,
    Values,
    refuted,
    shows,
    shrink_in_balance,
    shrink_of,
    untold,
)
from gap_diagnosis.evidence.describe import given_shape, with_model_error
from gap_diagnosis.input.data import Record
from gap_diagnosis.parameters import Estimates, Parameters, plain_values
from gap_diagnosis.residuals.kinematics import Kinematics
from gap_diagnosis.residuals.nominal import QUANTISATION
from gap_diagnosis.selection.contained import contained
from gap_diagnosis.selection.model import Evidence
from gap_diagnosis.selection.parts import Part
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile
from stage_twin.effects import EFFECTS, effect_of, link_of, misreads

#: Share of the gap that is noise beside what no second run repeats: what an effect moves counts
#: only if it shrinks the gap by `LEAST_SHRINK`. Wrong ones shrank it by 0.01, right ones by 0.17.
CHANCE = math.sqrt((1.0 - LEAST_SHRINK) ** -2 - 1.0)


@dataclass(frozen=True)
class Run:
    """The corrected twin beside the held-out records: what its effects are judged by.

    Attributes
    ----------
    scored : records on which the gap counts
    channels : the gap of the nominal and of the corrected twin
    parameters : of all effects, with standard deviations
    floors : noise floor of each channel
    unrepeated : effects that the loop is run without, as no second run repeats what they do
    sliding : rows of encoders at which their axis slides, where the twin states a friction, and
        by what chance moves such an encoder [m]
    """

    scored: list[Record]
    twin: TwinFile
    parts: list[Part]
    channels: dict[str, Channel]
    parameters: Parameters
    floors: dict[str, float]
    seed: int
    unrepeated: tuple[str, ...] = ()
    sliding: Mapping[str, Sliding] = field(default_factory=dict)

    @property
    def unrepeated_axes(self) -> set[str]:
        """Axes that go another way at each run."""
        return {name[-1] for name in self.unrepeated}


def cause_of(name: str, run: Run) -> judge.Cause:
    """Gap without this one cause, gap with all of them, and the interval of the difference."""
    showing = [p for p in run.parts if name in p.selection.accepted]
    part = showing[0] if showing else None
    if part is not None and name in part.swinging:
        shrink = _in_balance(name, part, run.seed)
    else:
        shrink = _in_loop(name, run, showing)
        if part is not None and _told_by_balance(name, part, shrink, run):
            shrink = _in_balance(name, part, run.seed)
    found = part.selection.evidence[name] if part is not None else None
    stated = with_model_error(name, run.parameters[name])
    own = judged_values(name, run.parameters[name], part, run.twin)
    return judge.Cause(
        effect=name,
        probability=0.0,
        parameters=stated,
        gap_before=shrink.before,
        gap_after=shrink.after,
        interval=shrink.interval,
        unit=shrink.unit,
        refuted=_refuted(name, showing, shrink, own, run.twin),
        status='accepted',
        alternatives=_alternatives(name, stated, found),
        strength=max((judge.strength(p, name) for p in showing), default=judge.READ),
        contains=contained(part, name, run.seed),
    )


def judged_values(name: str, found: Estimates, part: Part | None, twin: TwinFile) -> Estimates:
    """Parameters with the deviations by which an effect is judged to be there.

    The shape that was found is held: the question is whether there is anything of that shape.
    Where the twin states the effect itself, the question is whether the machine has another one.
    The stated one has a shape of its own, so that the deviations are those with the shape free.
    """
    shaped = (link_of(name) != 'servo' or effect_of(name).by_shape) and name not in twin.effects
    if part is not None and shaped:
        found = given_shape(name, found, part.selection, part.selector.regression)
    # Models of forces have errors, so that their effects are judged with them.
    return with_model_error(name, found) if link_of(name) == 'servo' else found


def _alternatives(name: str, stated: Values, found: Evidence | None) -> list[str]:
    """Effects that do as well in its place, and those that no record tells from it."""
    effect, axis = split_effect(name)
    values = {**EFFECTS[effect].defaults(), **{k: v for k, (v, _) in stated.items()}}
    same = [f'{other}.{axis}' for other in EFFECTS[effect].same(values)]
    return list(dict.fromkeys([*(found.alternatives if found is not None else []), *same]))


def swings(parts: Sequence[Part]) -> tuple[str, ...]:
    """Accepted effects that make the loop swing at a phase of its own."""
    return tuple(n for p in parts for n in p.swinging)


def unrepeated_notes(unrepeated: Sequence[str]) -> list[str]:
    """What a reader has to know of effects that the loop is run without."""
    steps = [name for name in unrepeated if split_effect(name)[0] == QUANTISATION]
    return [
        *(
            f'{name}: the corrected twin follows the record no better with these steps, because '
            'it rounds at other moments. It is run without them here, and they count in the noise '
            'floor; corrected_twin.yaml has them'
            for name in steps
        ),
        *_swing_notes([name for name in unrepeated if name not in steps]),
    ]


def _swing_notes(swinging: Sequence[str]) -> list[str]:
    return [
        f'{name} makes the loop swing at a phase that no second run repeats: it closes no gap of '
        'the positions, and is judged by the force balance and by how far the loop swings'
        for name in swinging
    ]


def _in_loop(name: str, run: Run, showing: list[Part]) -> Shrink:
    """How far an effect shrinks the gap of the twin as it is run.

    Where the twin states a friction, and the gap does not tell, it counts where the axis slides:
    no two models of a friction agree before that.
    """
    out = {name, *run.unrepeated}
    told = {n: v for n, v in plain_values(run.parameters).items() if n not in out}
    lesser = without_cause(name, told, run.scored, run.twin, showing, run.channels)
    chance = {
        n: CHANCE * run.channels[n].rms('after') if n[-1] in run.unrepeated_axes else 0.0
        for n in run.floors
    }
    encoders = [c for n, c in run.channels.items() if n.startswith('encoder')]
    calm = {c.name for c in encoders if not shows(np.concatenate(c.after), run.floors[c.name])}
    if misreads(name):
        # What an encoder reads falsely looks like its noise, and may make it no worse.
        calm -= {f'encoder.{split_effect(name)[1]}'}
    balance = max((p.selection.evidence[name].share for p in showing), default=0.0)

    def shrink(sliding: Mapping[str, Sliding]) -> Shrink:
        sides = {
            n: channel.sides(
                max(chance[n], run.floors[n]),
                lesser[n],
                sliding[n].rows if n in sliding else None,
            )
            for n, channel in run.channels.items()
        }
        still = {n for n, own in sliding.items() if own.is_noise(sides[n])}
        return shrink_of(name, sides, run.seed, calm | still, len(showing) > 1, balance)

    whole = shrink({})
    if not run.sliding or sticks([name]) or (whole.matters and not whole.worse):
        return whole
    moving = shrink(run.sliding)
    return moving if moving.matters and not moving.worse else whole


def _told_by_balance(name: str, part: Part, shrink: Shrink, run: Run) -> bool:
    """Whether an effect is most of what the balance shows, on an axis whose loop does not tell it.

    That is one with an effect that no second run repeats. It is also one that a friction holds,
    as it rests where chance has it, if nothing but noise is left of the balance.
    """
    if shrink.matters or not part.selection.evidence[name].share > LEAST_SHARE:
        return False
    axis = part.name[-1]
    if axis in run.unrepeated_axes:
        return True
    held = sticks(n for n in (*run.twin.effects, *run.parameters) if split_effect(n)[1] == axis)
    noise, fit = part.selector.noise, part.selection.fit
    alone = fit.mean_square(part.problem) < noise < part.selection.evidence[name].gain
    return held and alone and not shrink.worse


def _in_balance(name: str, part: Part, seed: int) -> Shrink:
    """How far an effect shrinks the residual of the force balance."""
    less = part.selector.without_effect(part.selection.fit, name)
    rows = part.selector.problem.judged
    without, with_it = (f.crossed[rows] ** 2 for f in (less, part.selection.fit))
    return shrink_in_balance(without, with_it, part.selector.problem.floor, seed)


def shown_by_encoder(
    part: Part,
    channels: dict[str, Channel],
    floors: dict[str, float],
    twin: TwinFile,
    accepted: Sequence[str],
) -> bool:
    """Whether the encoder shows what a force balance leaves; a tracker's residual shows itself.

    The balance differentiates what the encoder reads. Where it is known to misread,
    the twin's run tells what is left beside that, as a share of the squared gap.
    """
    axis = part.name[-1]
    encoder = channels.get(f'encoder.{axis}')
    if not part.name.startswith('servo') or encoder is None or twin.kind != 'servo':
        return True
    floor = floors[encoder.name]
    if any(misreads(n) for n in accepted if split_effect(n)[1] == axis):
        left = encoder.rms('after') ** 2 - floor**2
        return left > judge.SERVO_STRUCTURE * encoder.rms('before') ** 2
    return shows(np.concatenate(encoder.after), floor)


def _refuted(name: str, parts: list[Part], shrink: Shrink, values: Values, twin: TwinFile) -> bool:
    """Whether an effect breaks an invariant.

    A controller that was read from the record may make no channel worse. What measures is exact.
    What was taken out of the points has no least gain, but it may not be what another effect put
    in. How much the rests of a stepper have to show is judged by the selection.
    """
    if not parts:
        return link_of(name) == 'servo' and bool(shrink.worse)
    if any(isinstance(p.rows, Kinematics) and p.rows.rests for p in parts):
        return bool(shrink.worse) or untold(name, values, twin.effects.get(name))
    if any(name in p.problem.before for p in parts):
        unshown = shrink.interval[0] <= 0.0
        return unshown or bool(shrink.worse) or untold(name, values, twin.effects.get(name))
    return refuted(name, shrink, values, twin.effects.get(name))
