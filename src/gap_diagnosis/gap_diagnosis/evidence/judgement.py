"""From gains to judgements: structure that remains, strength of a cause, floors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.input.data import Record
from gap_diagnosis.input.noise import encoder_step
from gap_diagnosis.parameters import Parameters
from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.selection.model import Evidence
from stage_core.arrays import Array
from stage_core.quantities import UNKNOWN
from stage_core.twin_file import TwinFile
from stage_twin.effects import effect_of

if TYPE_CHECKING:
    from gap_diagnosis.closed_loop.channels import Channel
    from gap_diagnosis.selection.parts import Part

NONE = 'none'

#: Share of the gap that may stay structured before something unknown is named: models of
#: friction and play are approximations of the real mechanisms.
SERVO_STRUCTURE = 0.04
TRACKER_STRUCTURE = 0.006


@dataclass(frozen=True)
class Structure:
    """Structured remainder of a part: its mean square, its share of the gap, the judgement."""

    mean_square: float
    share: float
    structured: bool


@dataclass(frozen=True)
class Rung:
    """One part of an effect: RMS of the residual without and with it, in the residual's unit."""

    effect: str
    before: float
    after: float
    interval: tuple[float, float]  # of the share by which the RMS shrinks
    parameters: dict[str, tuple[float, float]]

    @property
    def shrink(self) -> float:
        """1 - after / before."""
        return 1.0 - self.after / self.before if self.before > 0.0 else 0.0

    @property
    def supported(self) -> bool:
        """Whether the data show this part."""
        return self.interval[0] > 0.0


@dataclass
class Cause:
    """One entry of the report's list of causes."""

    effect: str
    probability: float
    parameters: dict[str, tuple[float, float]]
    gap_before: float
    gap_after: float
    interval: tuple[float, float]
    status: str
    alternatives: list[str] = field(default_factory=list)
    strength: float = 0.0
    contains: list[Rung] = field(default_factory=list)
    unit: str = 'm'  # of the gap: N where the controller takes the force up
    refuted: bool = False  # by the twin as it is run
    features: dict[str, float] = field(default_factory=dict)  # of the probability

    @property
    def shrink(self) -> float:
        """1 - after / before."""
        return 1.0 - self.gap_after / self.gap_before if self.gap_before > 0.0 else 0.0


def structure(
    problem: Problem, everywhere: Array, modelled: Array, answer: Array, name: str
) -> Structure:
    """What of the residual is no noise.

    The tracker's noise is white: the mean of the autocovariance at the first three lags is what
    a model could still predict, less that of the encoder's noise in a resonance (`answer`). The
    force balance has a known noise (the encoder's steps): what exceeds it is structure. Its share
    is of the gap that approximate models (all but those of the sensor link) have to explain:
    `modelled` (n,), and what the twin's own effects explain.
    """
    rows = problem.held_out
    residual = everywhere[rows]
    # Two effects that make up for one another explain no more than there is.
    whole = min(float(np.mean(of[rows] ** 2)) for of in (modelled, problem.target))
    gap = max(whole - problem.floor**2, 1e-300)
    if name == 'tracker':
        remaining = max(_follows(residual), _line(everywhere))
        remaining -= max(_follows(answer[rows]), _line(answer))
        # At one speed, and most of all where an axis goes slowly, rounding follows itself.
        remaining -= problem.rounding
        # What white noise shows by chance: three lags of n products.
        chance = 3.0 * float(np.mean(residual**2)) / math.sqrt(3.0 * len(residual))
        least = max((0.30 * problem.floor) ** 2, chance)
        share = min(max(remaining, 0.0) / gap, 1.0)
        return Structure(remaining, share, remaining > least and share > TRACKER_STRUCTURE)
    remaining = float(np.mean(residual**2)) - problem.floor**2
    share = min(max(remaining, 0.0) / (gap + problem.stated), 1.0)
    return Structure(
        remaining, share, remaining > 3.0 * problem.floor**2 and share > SERVO_STRUCTURE
    )


def slow_remainder(residual: Array, rows: NDArray[np.bool_]) -> float:
    """ρ of a remainder that follows itself slowly (r_k ≈ ρ r_(k-1)), beside white noise.

    The ratio of autocovariances at lags 4 and 2 knows nothing of the white part; 0 where less
    than a third of the variance is slow.
    """
    kept = residual[rows]
    c0, c2, c4 = (float(np.mean(kept[k:] * kept[: len(kept) - k])) for k in (0, 2, 4))
    if c2 < c0 / 3.0 or c4 <= 0.0:
        return 0.0
    return float(np.clip((c4 / c2) ** 0.5, 0.0, 0.995))


def _follows(residual: Array) -> float:
    """Mean autocovariance at the first three lags."""
    return float(np.mean([np.mean(residual[k:] * residual[:-k]) for k in (1, 2, 3)]))


def _line(residual: Array) -> float:
    """Mean square of the strongest spectral line, 0 where chance explains it (Fisher's g test)."""
    power = np.abs(np.fft.rfft(residual - residual.mean()))[1:] ** 2
    power /= 0.5 * len(residual) ** 2
    top = int(np.argmax(power))
    chance = len(power) * np.exp(-power[top] / max(float(np.median(power)) / np.log(2.0), 1e-300))
    if chance > 1e-4:
        return 0.0
    return float(power[max(0, top - 2) : top + 3].sum())


#: Strength of what was read from the record itself.
READ = 1e3


def strength(part: Part, name: str) -> float:
    """Gain of an accepted effect over the least gain that counts, 1 at the least.

    One that was accepted with less is what was lacking in the balance or in the loop.
    """
    evidence = part.selection.evidence[name]
    return max(evidence.gain / part.selector.least(name), 1.0)


def rejected_causes(
    parts: list[Part], accepted: list[str], structured: bool, before: float, after: float
) -> list[Cause]:
    """The candidates that were looked at and not taken, with what they would have gained."""
    out: list[Cause] = []
    for part in parts:
        evidence: dict[str, Evidence] = part.selection.rejected
        for name, found in evidence.items():
            if name in accepted or any(name == other.effect for other in out):
                continue
            noise = part.selector.rules.of_noise * part.selector.noise
            out.append(
                Cause(
                    effect=name,
                    probability=0.0,
                    parameters={},
                    gap_before=after,
                    gap_after=after,
                    interval=(0.0, 0.0),
                    status='below_noise' if 0.0 < found.gain < noise else 'rejected',
                    strength=max(found.gain, 0.0) / part.selector.least(name)
                    if found.admissible
                    else 0.0,
                )
            )
    for name in (UNKNOWN, NONE):
        named = (name == UNKNOWN and structured) or (
            name == NONE and not accepted and not structured
        )
        out.append(
            Cause(name, 0.0, {}, after, after, (0.0, 0.0), 'accepted' if named else 'rejected')
        )
    return out


def name_beside_unknown(
    causes: Sequence[Cause], parts: Sequence[Part], refuted: Sequence[str]
) -> None:
    """Lists with `unknown` what a residual shows although no run of the twin can confirm it."""
    shown = {n for p in parts for n in p.unconfirmed}
    shown |= {n for n in refuted if effect_of(n).swings}
    for cause in causes:
        if cause.effect == UNKNOWN and cause.status == 'accepted':
            cause.alternatives = sorted(shown)


def channel_floor(twin: TwinFile, channel: str, resolution: float | None = None) -> float:
    """Noise floor of a channel: the encoder's step / √12, or the tracker's noise [m]."""
    if channel.startswith('tracker'):
        return twin.tracker.noise if twin.tracker is not None else 1.0e-6
    stated = float(getattr(twin.axes[channel[-1]], 'encoder_resolution', 1e-6))
    step = max(resolution or 0.0, stated)
    return step / math.sqrt(12.0)


def noise_floor(
    twin: TwinFile,
    channels: dict[str, Channel],
    effects: dict[str, dict[str, float]],
    tracker_speeds: dict[str, float],
) -> float:
    """Root mean of the floors of the position channels of the corrected twin [m].

    `tracker_speeds` are those of the axes at the tracker points [m/s], by which stamps that
    scatter move them.
    """
    squares = []
    jitter = effects.get('sample_jitter', {}).get('tracker_std', 0.0)
    for name, channel in channels.items():
        if channel.unit == 'm':
            step = effects.get(f'encoder_quantisation.{name[-1]}', {}).get('resolution')
            moved = jitter * tracker_speeds[name[-1]] if name.startswith('tracker') else 0.0
            squares.append(channel_floor(twin, name, step) ** 2 + moved**2)
    return math.sqrt(float(np.mean(squares)))


def encoder_steps(records: list[Record], twin: TwinFile) -> Parameters:
    """`encoder_quantisation` of each axis whose encoder counts coarser than the twin says."""
    out = {}
    for i, axis in enumerate(records[0].axes):
        nominal = float(getattr(twin.axes[axis], 'encoder_resolution', 1e-6))
        step = min(encoder_step(r.encoder[:, i]) for r in records)
        if step > 1.5 * nominal:
            out[f'encoder_quantisation.{axis}'] = {'resolution': (step, 1e-3 * step)}
    return out
