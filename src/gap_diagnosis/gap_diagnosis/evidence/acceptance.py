"""What every accepted effect has to show, whatever selected it: the invariants of a report.

The selection works on residuals of equations; its user runs the twin. So an effect stays only if
the held-out gap of the twin as it is run shrinks by it (`Shrink`), if no channel grows by it, and
if its parameters are away from those of a machine without it and from their bounds.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gap_diagnosis.evidence.calibrated import SPREAD
from gap_diagnosis.evidence.describe import model_of
from gap_diagnosis.evidence.judgement import SERVO_STRUCTURE
from gap_diagnosis.input.noise import CLEARLY, white_part
from gap_diagnosis.selection.forward import LACKING
from gap_diagnosis.selection.gains import weights
from stage_core.arrays import Array
from stage_core.metrics import SIGMAS
from stage_core.quantities import split_effect
from stage_twin.effects import EFFECTS, effect_of, link_of

Values = Mapping[str, tuple[float, float]]

#: The same of the largest of many: noise has this amplitude at one of the hundred periods that a
#: travel holds in 3 % of all records. Of 22 ripples on six simulators the wrong ones had 3 to 15
#: deviations, the right ones 82 and more. A friction that the twin states follows a law that is
#: not the machine's to the letter: foreign frictions that were as stated were 2 to 4
#: deviations away from it, five others 33 to 152.
LARGEST_OF_MANY = 4.0
#: Of the bootstrap.
BLOCKS, DRAWS = 48, 500
#: Floors above which a gap is there whatever the selection says. Twins without a gap are at 1.05.
FAR = 2.0
#: The same beside named effects, and the share of the squared gap that they then leave. Models are
#: approximations: right ones of a friction left 1 to 9 % on four sessions and 39 % on a fifth, a
#: friction that nothing names left 34 %. On 143 sessions of two foreign simulators right ones left
#: 12 % at most, mechanisms that nothing names 18 to 67 % on three; the right ripple of a recorded
#: motor leaves more than 15 %. The floors hold beside a stated friction, too: four machines that
#: lack nothing else were at 2.9 at most, two that lack an effect at 14 and 39.
FAR_BESIDE, SHARE_BESIDE = 4.0, 0.25
#: Least share by which a servo effect shrinks the gap, unless it moves it by the noise floor:
#: other effects take up the errors of models of forces. Right names shrink it by 0.23 and more,
#: wrong ones by 0.14 at most.
LEAST_SHRINK = 0.1
#: Least share of the squared gap of its axis, above the floor, that a servo effect closes: what is
#: less, the models of other effects leave. Of 423 named causes the five wrong ones closed 0.000
#: to 0.005, the right ones 0.014 and more but for one (0.004). An effect that is most of what was
#: lacking (`LACKING`), in the loop or in the force balance, may be less: a base beside a friction
#: closed 0.006 of the gap, and 0.9 of what the friction left; a resonance 0.002 of it, and 0.95 of
#: what the balance left.
LEAST_CLOSED = 0.01
#: Least share of the squared noise of the positions that any other effect closes; the noise is
#: their floor, or the gap that is left if that is less. Of 177 named causes the two wrong ones
#: closed 0.002 and 0.065 of the floor, the right ones 0.127 and more.
LEAST_SEEN = 0.1
#: Squared gap of an encoder over its white part up to which it is noise that the loop answers: 1.2
#: to 1.4 on machines without effects, 1200 and more with a mechanism that no name fits.
ANSWERED = 2.0


@dataclass(frozen=True, eq=False)
class Sides:
    """Squared gap of one channel on the held-out rows (n,), without and with an effect.

    `nominal` is the mean square with no effect at all.
    """

    without: Array
    with_it: Array
    unit: str
    floor: float
    nominal: float = 0.0


@dataclass(frozen=True)
class Shrink:
    """What one effect does to the gap: RMS without and with it, the share by which it shrinks.

    `unit` is N for an effect whose force the controller takes up so that no position shows it,
    else m; `interval` is that of 95 %, of which the lower end has to be above `least`; `worse`
    names the channels that grow by the effect; `closes` is its share of the squared gap of its
    axis; `explained` tells that its encoder shows noise alone with all effects, and `clear` that
    the squared gap of one channel shrinks by more than its own noise.
    """

    unit: str
    before: float
    after: float
    interval: tuple[float, float]
    floor: float
    least: float
    worse: tuple[str, ...] = ()
    closes: float = 1.0
    explained: bool = False
    clear: bool = False
    own: Shrink | None = None  # of the channels that it moves, where others hide it
    balance: float = 0.0  # share that it explains of what the force balance leaves without it

    @property
    def share(self) -> float:
        """1 - after / before."""
        return 1.0 - self.after / self.before if self.before > 0.0 else 0.0

    @property
    def lacking(self) -> float:
        """Share that it closes of the squared gap that is left without it, above the floor."""
        left = self.before**2 - self.floor**2
        return (self.before**2 - self.after**2) / left if left > 0.0 else 0.0

    @property
    def matters(self) -> bool:
        """Whether the gap shrinks for certain, and by more than a user could call nothing."""
        closed = self.before**2 - self.after**2
        if self.own is not None:
            # A gap that is left below the floor shows that the noise was taken for too large.
            noise = min(self.floor, self.after)
            seen = self.clear or closed > LEAST_SEEN * noise**2
            return self.own.matters and (self.least > 0.0 or seen)
        if self.explained and self.balance > LACKING:
            # No error of another model is left that it could have taken up.
            return self.interval[0] > 0.0
        small = self.closes < LEAST_CLOSED and max(self.lacking, self.balance) < LACKING
        if self.least > 0.0 and small and not self.explained:
            return False
        beyond_noise = self.unit == 'm' and closed > self.floor**2
        return self.interval[0] > (0.0 if beyond_noise else self.least)


def shrink_of(
    name: str,
    sides: Mapping[str, Sides],
    seed: int,
    noise: Collection[str] = (),
    shown_twice: bool = False,
    balance: float = 0.0,
) -> Shrink:
    """How far an effect shrinks the gap, from the channels without and with it.

    `noise` names encoders that show noise alone with all effects. None of them is worse by an
    effect: the loop answers the steps of the encoder by chance. If that of its axis is one, no
    error of another model is left that an effect could have taken up.

    `shown_twice` tells that both the force balance and the tracker's residual show the effect: no
    error of a model of forces makes the tracker swing. `balance` is the share that the effect
    explains of what the force balance leaves without it.

    Positions count all together, as `gap.before` does; whether the effect matters is judged on
    those that it moves, as the noise of the others hides what it does. Where what is unknown moves
    the tracker by far more than a servo effect does, the encoder of its axis counts alone. Where
    the effect moves nothing that a user would see, the force of its axis counts: the controller
    takes it up.
    """
    positions = [s for s in sides.values() if s.unit == 'm']
    moved = [s for s in positions if not np.array_equal(s.without, s.with_it)] or positions
    worse = tuple(
        n
        for n, s in sides.items()
        if s.unit == 'm' and n not in noise and shrink_interval([s], seed)[1] < 0.0
    )
    explained = f'encoder.{split_effect(name)[1]}' in noise
    force = sides.get(f'force.{split_effect(name)[1]}')
    servo = link_of(name) == 'servo'
    least = LEAST_SHRINK if servo and not shown_twice else 0.0
    closes = _closes(positions, _gaps_of_axis(sides, name[-1]))
    own = replace(_shrink(moved, least, worse, seed, closes), explained=explained, balance=balance)
    clear = any(np.mean(s.without - s.with_it) > s.floor**2 for s in positions)
    seen = replace(_shrink(positions, least, worse, seed, closes), own=own, clear=clear)
    if seen.matters or not servo:
        return seen
    for other in (sides.get(f'encoder.{split_effect(name)[1]}'), force):
        if other is not None:
            alone = _shrink([other], LEAST_SHRINK, worse, seed, _closes([other], [_gap(other)]))
            if alone.matters:
                return alone
    return seen


def shrink_in_balance(without: Array, with_it: Array, floor: float, seed: int) -> Shrink:
    """What an effect does to the force balance: squared residuals (n,) [N^2] of its rows."""
    return _shrink([Sides(without, with_it, 'N', floor)], LEAST_SHRINK, (), seed)


def _closes(moved: Sequence[Sides], gaps: Sequence[float]) -> float:
    """What an effect closes of channels as a share of the squared gaps of those of its axis."""
    closed = sum(float(s.without.mean() - s.with_it.mean()) for s in moved)
    return closed / sum(gaps) if sum(gaps) > 0.0 else 1.0


def _gaps_of_axis(sides: Mapping[str, Sides], axis: str) -> list[float]:
    """Squared gaps [m^2] of an axis: the encoder's, and what the tracker can see of it.

    Whatever else the tracker shows is of other links: a latency hides no wrong mass.
    """
    gaps = {n: _gap(s) for n, s in sides.items() if s.unit == 'm' and n[-1] == axis}
    most = gaps.get(f'encoder.{axis}', np.inf)
    return [min(gap, most) for gap in gaps.values()]


def _gap(side: Sides) -> float:
    """Squared gap of a channel above its floor."""
    return max(side.nominal - side.floor**2, 0.0)


def _shrink(
    counted: Sequence[Sides],
    least: float,
    worse: tuple[str, ...],
    seed: int,
    closes: float = 1.0,
) -> Shrink:
    before, after, floor = (
        float(np.sqrt(np.mean(squares)))
        for squares in (
            [s.without.mean() for s in counted],
            [s.with_it.mean() for s in counted],
            [s.floor**2 for s in counted],
        )
    )
    interval = shrink_interval(counted, seed)
    return Shrink(counted[0].unit, before, after, interval, floor, least, worse, closes)


def shrink_interval(sides: Sequence[Sides], seed: int) -> tuple[float, float]:
    """95 % interval of the share by which the RMS shrinks; bootstrap over blocks of time.

    Of no gap nothing shrinks.
    """
    if not any(s.without.any() for s in sides):
        return 0.0, 0.0
    blocks = min(BLOCKS, *(len(s.with_it) for s in sides))
    without, with_it = (
        np.mean([[b.mean() for b in np.array_split(s, blocks)] for s in of], axis=0)
        for of in ([s.without for s in sides], [s.with_it for s in sides])
    )
    drawn = weights(seed, DRAWS, blocks)
    ratio = drawn @ with_it / np.maximum(drawn @ without, 1e-30)
    low, high = np.percentile(1.0 - np.sqrt(ratio), [2.5, 97.5])
    return float(low), float(high)


def refuted(
    name: str, shrink: Shrink, values: Values, nominal: Mapping[str, float] | None = None
) -> bool:
    """Whether an effect breaks one of the invariants.

    `nominal` are the values that the twin states of the effect itself, if it does: then these
    are what a finding has to be away from, and none of the effect is a value as any other.
    """
    return not shrink.matters or bool(shrink.worse) or untold(name, values, nominal)


def untold(name: str, values: Values, nominal: Mapping[str, float] | None = None) -> bool:
    """Whether no parameter of an effect is for certain another than without it.

    So it is with a shape that may as well be beyond what the effect has (`inside`).
    """
    stated = nominal or {}
    pairs = [p for p in effect_of(name).differ if set(p) <= set(values)]
    # What a model gets wrong it gets wrong in both: it parts none of them.
    shared = SPREAD[model_of(name)][0]
    if pairs and not any(apart(values[one], values[other], shared) for one, other in pairs):
        return True
    shapes = [p for p in effect_of(name).parameters if p.inside and p.name in values]
    if not all(away(values[p.name], None, p.minimum, p.maximum) for p in shapes):
        return True
    told = [p for p in effect_of(name).parameters if p.name in defining(name) & set(values)]
    # What the session does not show (no deviation) says nothing of the effect.
    told = [p for p in told if values[p.name][1] > 0.0]
    reach = LARGEST_OF_MANY if stated or effect_of(name).scanned else SIGMAS
    return bool(told) and not any(
        away(values[p.name], stated.get(p.name, p.neutral), p.minimum, p.maximum, p.neutral, reach)
        for p in told
    )


def defining(name: str) -> set[str]:
    """Parameters that make the effect what it is: at least one of them is not neutral.

    Shapes and phases (`neutral` None), stated geometry and what an effect shares with a special
    case of its own do not tell that it is there.
    """
    effect = effect_of(name)
    shared = {p.name for other in effect.holds for p in EFFECTS[other].parameters}
    return {
        p.name
        for p in effect.parameters
        if p.fitted and p.neutral is not None and p.name not in shared
    }


def apart(one: tuple[float, float], other: tuple[float, float], shared: float) -> bool:
    """Whether two values (with their standard deviations) differ by more than their interval.

    `shared` is the factor by which an error of both has widened the deviations.
    """
    return abs(one[0] - other[0]) > SIGMAS / shared * float(np.hypot(one[1], other[1]))


def away(
    value: tuple[float, float],
    nominal: float | None,
    minimum: float,
    maximum: float,
    neutral: float | None = None,
    sigmas: float = SIGMAS,
) -> bool:
    """Whether a value is further than its interval from the twin's and from its bounds.

    A bound at which there is nothing of an effect (`neutral`) bounds no model.
    """
    number, reach = value[0], sigmas * value[1]
    ends = [end for end in (minimum, maximum) if end not in (nominal, neutral)]
    margin = max(reach, 1e-6 * (maximum - minimum))
    return (nominal is None or abs(number - nominal) > reach) and all(
        abs(number - end) > margin for end in ends
    )


def shows(after: Array, floor: float) -> bool:
    """Whether a gap of an encoder (n,) [m] is more than rounding and noise, the loop's answer too.

    The record's noise is told from rounding only where its variance is `CLEARLY` more.
    """
    square = float(np.mean(after**2))
    white = white_part(after, np.ones(len(after), dtype=bool))
    return square > 1.05**2 * (1.0 + CLEARLY) * floor**2 and square > ANSWERED * white**2


def far_from_explained(
    before: float, after: float, floor: float, named: bool, stated: float = 0.0
) -> bool:
    """Whether the twin as it is run leaves a gap that the named effects cannot be said to explain.

    Parameters
    ----------
    before, after : RMS of the held-out gap without and with the named effects [m]
    floor : noise floor of the same channels [m]
    named : whether any effect is named
    stated : RMS of that gap without the frictions that the twin states [m]: of these, too,
        models are approximations
    """
    if not named:
        return before > (FAR_BESIDE if stated > 0.0 else FAR) * floor
    least = max(SERVO_STRUCTURE * stated**2, SHARE_BESIDE * before**2)
    return after > FAR_BESIDE * floor and after**2 - floor**2 > least
