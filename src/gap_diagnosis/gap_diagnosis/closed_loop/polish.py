"""Last refinement of servo effects in closed loop, from the warm start of the force balance.

The force balance weighs all frequencies alike in force; the user's gap is the encoder's. A few
damped Gauss-Newton steps on the replayed encoder, on fit windows only, close the difference.
They are kept only if the gap on these windows shrinks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.closed_loop.replay import fitted_gap, of_axis, replay
from gap_diagnosis.closed_loop.steps import stepless, without_steps
from gap_diagnosis.evidence.acceptance import FAR_BESIDE
from gap_diagnosis.evidence.judgement import channel_floor
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import Ticks, fitted_ticks
from gap_diagnosis.parameters import Effects, Parameters, plain_values
from gap_diagnosis.residuals.measured_noise import with_noise
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.metrics import SIGMAS
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile
from stage_twin.effects import EFFECTS

#: Steps at most, and by which shares of the squared noise and of the squared gap above it a step
#: has to lower the gap. What lies above the noise is a model's error, which says less than noise.
ROUNDS, SETTLED, SETTLED_ABOVE = 40, 1e-4, 1e-3
REACH = 2.0  # of the first step, in `_Loop.scale`; each later one reaches twice as far
#: Damping of the first step, a share of the diagonal; ten times more after one that leaves more.
DAMPING, TRIES = 1e-2, 4
MOVED = 0.03  # in `_Loop.scale`, of a parameter by which the gap is differentiated
#: Share of the gap that a refinement leaves where it is another one than the force balance's. The
#: gap of a loop that sticks hangs on chance: it is 0.14 and 0.21 of that with the force balance's
#: value where the other one is true, and 0.67 where the force balance is right.
MUCH_BETTER = 0.4
BLOCK = 2.0  # s, left out at a time


@dataclass(frozen=True)
class _Loop:
    """The replayed encoder of an axis as a function of the parameters of its effects.

    Parameters are counted in `scale` from where they start, z (k,). `floor` [m] is the encoder's
    noise.
    """

    records: list[Record]
    twin: TwinFile
    axis: str
    effects: Effects
    names: list[tuple[str, str]]
    start: Array
    scale: Array
    ticks: Ticks
    floor: float

    def bounds(self) -> tuple[Array, Array]:
        """The least and the largest z (k,)."""
        low, high = self._ends()
        return (low - self.start) / self.scale, (high - self.start) / self.scale

    def values(self, z: Array) -> Array:
        """Parameters (k,) at z, none beyond its bounds, not even by a rounding."""
        return np.clip(self.start + self.scale * z, *self._ends())

    def _ends(self) -> tuple[Array, Array]:
        """The least and the largest parameters (k,)."""
        known = [EFFECTS[split_effect(e)[0]].parameter(key) for e, key in self.names]
        low, high = (np.array([getattr(b, end) for b in known]) for end in ('minimum', 'maximum'))
        return low, high

    def gap(self, z: Array) -> Array:
        """Gap (n,) of the encoder on the ticks that fit [m]."""
        effects = {e: dict(p) for e, p in self.effects.items()}
        for (effect, key), value in zip(self.names, self.values(z), strict=True):
            effects[effect][key] = float(value)
        gaps = [replay(r, self.twin, effects)[f'encoder.{self.axis}'] for r in self.records]
        return np.concatenate([g[self.ticks(r)] for g, r in zip(gaps, self.records, strict=True)])

    def blocks(self) -> NDArray[np.int64]:
        """Number (n,) of the block of time of each of these ticks."""
        marks, offset = [], 0
        for record in self.records:
            marks.append((record.time[self.ticks(record)] / BLOCK).astype(np.int64) + offset)
            offset = int(marks[-1].max(initial=offset)) + 1
        return np.unique(np.concatenate(marks), return_inverse=True)[1]

    def slopes(self, z: Array, residual: Array) -> Array:
        """Derivative (n, k) of the gap after z."""
        steps = np.where(z + MOVED > self.bounds()[1], -MOVED, MOVED)
        moved = [self.gap(z + step) for step in np.diag(steps)]
        return np.column_stack([(m - residual) / s for m, s in zip(moved, steps, strict=True)])

    def lowest(self) -> tuple[Array, Array, Array]:
        """z (k,) of the least gap, the gap (n,) there and its derivative (n, k).

        Levenberg and Marquardt's steps, as long as they reach further. A derivative costs a run
        for each parameter: it follows the steps (Broyden, Mathematics of Computation 19, 1965) and
        is taken anew where a step does not help, or helps no more.
        """
        z, damping, reach, fresh = np.zeros(len(self.names)), DAMPING, REACH, True
        residual = self.gap(z)
        slopes = self.slopes(z, residual)
        for _ in range(ROUNDS):
            there, trial, damping = self._step(z, residual, slopes, damping, reach)
            before, after = float(residual @ residual), float(trial @ trial)
            noise = min(self.floor**2 * len(residual), before)
            settled = before - after < SETTLED * noise + SETTLED_ABOVE * (before - noise)
            if after < before:
                slopes = _followed(slopes, there - z, trial - residual)
                z, residual, damping = there, trial, 0.1 * damping
                reach *= 2.0  # the deviations of the balance may be far too small
            if settled and fresh:
                break
            fresh = settled
            if fresh:
                slopes, damping = self.slopes(z, residual), DAMPING
        return z, residual, slopes if fresh else self.slopes(z, residual)

    def _step(
        self, z: Array, residual: Array, slopes: Array, damping: float, reach: float
    ) -> tuple[Array, Array, float]:
        """Where a step from z leads, the gap (n,) there, and the damping with which it helps."""
        low, high = self.bounds()
        gram, right = slopes.T @ slopes, slopes.T @ residual
        for _ in range(TRIES):
            move = np.clip(_step(gram, right, damping), -reach, reach)
            there = np.clip(z + move, low, high)
            trial = self.gap(there)
            if trial @ trial < residual @ residual:
                break
            damping *= 10.0
        return there, trial, damping

    def covariance(self, slopes: Array, residual: Array) -> Array:
        """Covariance (k, k) of z: how far a step moves when a block of time is left out.

        Delete-one jackknife (Efron and Tibshirani, An introduction to the bootstrap, 1993,
        chapter 11). Blocks are longer than what the loop and a model's error remember.
        """
        labels = self.blocks()
        count = int(labels.max()) + 1
        order = [labels == b for b in range(count)]
        grams = np.array([slopes[o].T @ slopes[o] for o in order])
        rights = np.array([slopes[o].T @ residual[o] for o in order])
        moves = np.array(
            [
                _step(grams.sum(0) - g, rights.sum(0) - r, 1e-9)
                for g, r in zip(grams, rights, strict=True)
            ]
        )
        moves -= moves.mean(axis=0)
        return np.asarray(moves.T @ moves * (count - 1) / count)


def _followed(slopes: Array, move: Array, change: Array) -> Array:
    """The derivative (n, k) nearest to the last that says what a move (k,) changed (n,)."""
    missed = change - slopes @ move
    return np.asarray(slopes + np.outer(missed, move) / max(float(move @ move), 1e-300))


def _step(gram: Array, right: Array, damping: float) -> Array:
    """Damped Gauss-Newton step (k,)."""
    size = np.sqrt(np.diag(gram)) + 1e-30
    scaled = gram / np.outer(size, size) + damping * np.eye(len(size))
    return np.asarray(-np.linalg.solve(scaled, right / size) / size)


@dataclass(frozen=True)
class LoopFit:
    """A fit of servo effects of an axis to some ticks of its encoder.

    Attributes
    ----------
    records, twin : of the session, and the nominal twin
    axis : whose encoder counts
    fixed : effects of the axis that the record itself tells: they stay as they are
    ticks : that count, by default those that no judgement sees
    """

    records: list[Record]
    twin: TwinFile
    axis: str
    fixed: Parameters = field(default_factory=dict)
    ticks: Ticks = fitted_ticks

    def polish(self, found: Parameters, alone: bool = False) -> Parameters:
        """Parameters of the effects, refined.

        Values stay unchanged where the loop stays far from the record, as one that sticks goes
        another way from a moment on, and where it needs the steps of its encoder to follow it.
        Elsewhere they are the mean of both estimates, each with the weight of its certainty, or
        the loop's `alone` where the balance holds errors that the ticks do not.
        """
        fitted = self._fitted(found)

        def left(effects: Parameters) -> float:
            values = plain_values({**self.fixed, **effects})
            return fitted_gap(fitted, self.twin, values, self.axis, draws=1, ticks=self.ticks)

        least = left(found)
        for effect, key, value in _tried(found):
            # How far the force balance was from it is all that is known of its deviation.
            apart = abs(value - found[effect].get(key, (0.0, 0.0))[0])
            other = {**found, effect: {**found[effect], key: (value, apart)}}
            if (gap := left(other)) < MUCH_BETTER * least:
                found, least = other, gap
        loop = self._loop(fitted, found)
        return _refined(loop, found, least, alone) if loop.names else found

    def closest(self, found: Parameters) -> float:
        """Least RMS [m] that effects leave of the gap, whatever their parameters.

        Infinite where no machine could run.
        """
        try:
            _, residual, _ = self._loop(self._fitted(found), found).lowest()
        except StageError:
            return math.inf
        return float(np.sqrt(np.mean(residual**2)))

    def _fitted(self, found: Parameters) -> list[Record]:
        """The records that are fitted, of the axis alone where no effect couples the axes."""
        effects = {**self.fixed, **found}
        fitted = [r for r in self.records if not r.held_out_session]
        return [of_axis(r, self.twin, effects, self.axis) for r in fitted]

    def _loop(self, fitted: list[Record], found: Parameters) -> _Loop:
        """The loop without steps of its encoder."""
        names = [(e, k) for e, of in found.items() for k, (_, std) in of.items() if std > 0.0]
        start, own = (np.array([found[e][k][i] for e, k in names]) for i in (0, 1))
        scale = np.maximum(3.0 * own, 0.02 * np.abs(start))
        effects = plain_values({**without_steps(self.fixed), **found})
        floor = channel_floor(with_noise(self.twin, fitted), f'encoder.{self.axis}')
        twin = stepless(self.twin, self.axis)
        return _Loop(fitted, twin, self.axis, effects, names, start, scale, self.ticks, floor)


def _refined(loop: _Loop, found: Parameters, least: float, alone: bool) -> Parameters:
    """The parameters by the loop `alone`, or also by the balance that found them.

    With these and the encoder's steps the loop leaves `least` [m].
    """
    try:
        z, residual, slopes = loop.lowest()
    except StageError:
        # A step left the range in which the twin is a machine: the warm start stands.
        return found
    first = fitted_gap(loop.records, loop.twin, loop.effects, loop.axis, draws=1, ticks=loop.ticks)
    left = float(np.sqrt(np.mean(residual**2)))
    if left > least or left > max(FAR_BESIDE * loop.floor, MUCH_BETTER * first):
        # The slopes of such a loop say nothing.
        return found
    own = np.array([found[e][k][1] for e, k in loop.names]) / loop.scale
    covariance = loop.covariance(slopes, residual)
    deviations = np.sqrt(np.diag(covariance))
    if not alone:
        z, deviations = _both(z, covariance, own)
    if not alone and left > min(FAR_BESIDE * loop.floor, MUCH_BETTER * first):
        # The loop does not refute the force balance, whose doubt counts on.
        deviations = np.hypot(deviations, own)
    values = loop.values(z)
    refined: Parameters = {e: dict(p) for e, p in found.items()}
    for (effect, key), value, std in zip(loop.names, values, loop.scale * deviations, strict=True):
        refined[effect][key] = (float(value), float(std))
    return refined


def _tried(found: Parameters) -> list[tuple[str, str, float]]:
    """Values that the force balance cannot tell well (`Parameter.tried`), by effect and name.

    Of some parameters (not `fitted`) it knows nothing at all.
    """
    return [
        (effect, known.name, value)
        for effect, of in found.items()
        for known in EFFECTS[split_effect(effect)[0]].parameters
        for value in known.tried
        if of.get(known.name, (0.0, float(not known.fitted)))[1] > 0.0
    ]


def _both(z: Array, covariance: Array, own: Array) -> tuple[Array, Array]:
    """Mean (k,) of the loop's estimate z and the balance's, which is zero; and its deviations.

    The deviations `own` (k,) of the balance's hold its distance from the interval of the loop's.
    Of nine values of five sessions the loop's were 0.3 to 2.2 of its deviations from the truth.
    """
    apart = np.maximum(own**2, z**2 - SIGMAS**2 * np.diag(covariance))
    gain = covariance @ np.linalg.inv(covariance + np.diag(apart))
    both = covariance - gain @ covariance
    return z - gain @ z, np.sqrt(np.maximum(np.diag(both), 0.0))
