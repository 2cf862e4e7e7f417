"""Last refinement of servo effects in closed loop, from the warm start of the force balance.

The force balance weighs all frequencies alike in force; the user's gap is the encoder's. A few
damped Gauss-Newton steps on the replayed encoder, on fit windows only, close the difference.
They are kept only if the gap on these windows shrinks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.closed_loop.replay import replay
from gap_diagnosis.evidence.acceptance import FAR_BESIDE
from gap_diagnosis.evidence.judgement import channel_floor
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import STARTED, held_out_windows, inside
from gap_diagnosis.parameters import Effects, Parameters, plain_values
from gap_diagnosis.residuals.measured_noise import with_noise
from stage_core.errors import StageError
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile
from stage_twin import hooks
from stage_twin.effects import EFFECTS

Array = NDArray[np.float64]

#: Steps at most, and the share of the squared gap above which a step leaves as much as the last.
ROUNDS, SETTLED = 8, 0.9
REACH = 2.0  # of the first step, in `_Loop.scale`; each later one reaches twice as far
WORTHWHILE = 0.97  # of the RMS on the fit windows
#: The same for a value that the force balance does not suggest. The gap of a loop that sticks
#: hangs on chance: it is 0.14 and 0.21 of that with the force balance's value where the other one
#: is true, and 0.67 where the force balance is right.
MUCH_BETTER = 0.4
BLOCK = 2.0  # s, left out at a time
#: Standard deviation of an estimate in its distance from another one of the same value.
AGREEMENT = 0.5**0.5


def one_axis(record: Record, axis: str) -> Record:
    """A record of one axis alone, without tracker."""
    i = record.column(axis)
    columns = {
        name: getattr(record, name)[:, [i]]
        for name in (
            'reference',
            'reference_velocity',
            'velocity_command',
            'force',
            'encoder',
        )
    }
    warm = None if record.temperature is None else record.temperature[:, [i]]
    return replace(
        record,
        axes=(axis,),
        moving=(record.moving[i],),
        temperature=warm,
        tracker=None,
        tracker_time=None,
        **columns,
    )


@dataclass(frozen=True)
class _Loop:
    """The replayed encoder of an axis as a function of the parameters of its effects.

    Parameters are counted in `scale` from where they start, z (k,).
    """

    records: list[Record]
    twin: TwinFile
    axis: str
    effects: Effects
    names: list[tuple[str, str]]
    start: Array
    scale: Array

    def values(self, z: Array) -> Array:
        """The parameters (k,), within their bounds."""
        bounds = [EFFECTS[split_effect(e)[0]].parameter(key) for e, key in self.names]
        low, high = ([getattr(b, end) for b in bounds] for end in ('minimum', 'maximum'))
        return np.clip(self.start + self.scale * z, low, high)

    def gap(self, z: Array) -> Array:
        """Gap (n,) of the encoder on the ticks that fit [m]."""
        effects = {e: dict(p) for e, p in self.effects.items()}
        for (effect, key), value in zip(self.names, self.values(z), strict=True):
            effects[effect][key] = float(value)
        gaps = [replay(r, self.twin, effects)[f'encoder.{self.axis}'] for r in self.records]
        return np.concatenate([g[m][::2] for g, m in zip(gaps, self._fitted(), strict=True)])

    def blocks(self) -> NDArray[np.int64]:
        """Number (n,) of the block of time of each of these ticks."""
        marks, offset = [], 0
        for record, mask in zip(self.records, self._fitted(), strict=True):
            marks.append((record.time[mask][::2] / BLOCK).astype(np.int64) + offset)
            offset = int(marks[-1].max(initial=offset)) + 1
        return np.unique(np.concatenate(marks), return_inverse=True)[1]

    def _fitted(self) -> list[NDArray[np.bool_]]:
        return [
            ~inside(r.time, held_out_windows(r)) & (r.time > STARTED) & r.whole(r.time)
            for r in self.records
        ]

    def slopes(self, z: Array, residual: Array) -> Array:
        """Derivative (n, k) of the gap after z."""
        moved = [self.gap(z + 0.3 * unit) for unit in np.eye(len(z))]
        return np.column_stack([(m - residual) / 0.3 for m in moved])

    def deviations(self, slopes: Array, residual: Array) -> Array:
        """Standard deviations (k,) of z: how far a step moves when a block of time is left out.

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
                _step(grams.sum(0) - g, rights.sum(0) - r)
                for g, r in zip(grams, rights, strict=True)
            ]
        )
        spread = np.sum((moves - moves.mean(axis=0)) ** 2, axis=0)
        return np.sqrt(spread * (count - 1) / count)


def _step(gram: Array, right: Array) -> Array:
    """Damped Gauss-Newton step (k,)."""
    damped = gram + np.diag(0.03 * np.diag(gram) + 1e-30)
    return np.asarray(-np.linalg.solve(damped, right))


def polish(
    records: list[Record], twin: TwinFile, axis: str, found: Parameters, fixed: Parameters
) -> Parameters:
    """Parameters of the servo effects of an axis, refined on the encoder of the fit windows.

    `fixed` are effects of the axis that the record itself tells: they stay as they are. Values
    stay unchanged where the gap is at the encoder's step already, nothing is gained, or the loop
    stays far from the record: one that sticks goes another way from a moment on. A
    standard deviation holds that of the closed loop and, unless the loop refutes the force
    balance and follows the record, the disagreement of the two estimates.
    """
    fitted = [r for r in records if not r.held_out_session]
    if not any(hooks.couples(split_effect(e)[0]) for e in {**fixed, **found}):
        fitted = [one_axis(r, axis) for r in fitted]
    floor = channel_floor(with_noise(twin, fitted), f'encoder.{axis}')
    best, least = _refined(fitted, twin, axis, found, fixed, floor)
    step = float(getattr(twin.axes[axis], 'encoder_resolution', 1e-6))
    for effect, key, value in _tried(found) if least >= step else ():
        apart = abs(value - found[effect][key][0])
        start = {**found, effect: {**found[effect], key: (value, 0.0)}}
        other, left = _refined(fitted, twin, axis, start, fixed, floor)
        if left < MUCH_BETTER * least:
            # How far the force balance was from it is all that is known of its deviation.
            best, least = {**other, effect: {**other[effect], key: (value, apart)}}, left
    return best


def _tried(found: Parameters) -> list[tuple[str, str, float]]:
    """Values that the force balance cannot tell well (`Parameter.tried`), by effect and name."""
    return [
        (effect, known.name, value)
        for effect, of in found.items()
        for known in EFFECTS[split_effect(effect)[0]].parameters
        for value in known.tried
        if of.get(known.name, (0.0, 0.0))[1] > 0.0
    ]


def _refined(
    records: list[Record],
    twin: TwinFile,
    axis: str,
    found: Parameters,
    fixed: Parameters,
    floor: float,
) -> tuple[Parameters, float]:
    """The parameters at an optimum of the closed loop near them, and the gap there [m]."""
    names = [(e, k) for e, of in found.items() for k, (_, std) in of.items() if std > 0.0]
    effects = plain_values({**fixed, **found})
    start, own = (np.array([found[e][k][i] for e, k in names]) for i in (0, 1))
    scale = np.maximum(3.0 * own, 0.02 * np.abs(start))
    loop = _Loop(records, twin, axis, effects, names, start, scale)
    z = np.zeros(len(names))
    step = float(getattr(twin.axes[axis], 'encoder_resolution', 1e-6))
    try:
        residual = loop.gap(z)
        first = float(np.sqrt(np.mean(residual**2)))
        if not names:
            return found, first
        slopes = loop.slopes(z, residual)
        for k in range(ROUNDS if first >= step else 0):
            reach = REACH * 2.0**k  # the deviations of the force balance may be far too small
            move = np.clip(_step(slopes.T @ slopes, slopes.T @ residual), -reach, reach)
            trial = loop.gap(z + move)
            share = float(trial @ trial) / max(float(residual @ residual), 1e-300)
            if share >= 1.0:
                break
            z, residual = z + move, trial
            slopes = loop.slopes(z, residual)
            if share > SETTLED:
                break
    except StageError:
        # A step left the range in which the twin is a machine: the warm start stands.
        return found, math.inf
    onward = np.clip(_step(slopes.T @ slopes, slopes.T @ residual), -REACH, REACH)
    left = float(np.sqrt(np.mean(residual**2)))
    if left > max(FAR_BESIDE * floor, MUCH_BETTER * first):
        # The slopes of such a loop say nothing.
        return found, first
    apart = z + onward
    if left < min(FAR_BESIDE * floor, MUCH_BETTER * first):
        # The loop follows the record, and refutes the force balance.
        apart, own = onward, np.zeros(len(names))
    if left > WORTHWHILE * first:
        z, left = np.zeros(len(names)), first
    spread = np.hypot(loop.deviations(slopes, residual), AGREEMENT * apart)
    deviations = np.hypot(own, scale * spread)
    refined: Parameters = {e: dict(p) for e, p in found.items()}
    for (effect, key), value, deviation in zip(names, loop.values(z), deviations, strict=True):
        refined[effect][key] = (float(value), float(deviation))
    return refined, left
