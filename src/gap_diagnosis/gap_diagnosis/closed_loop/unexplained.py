"""Whether the twin as it is run stays far from the record, whatever a selection says.

An axis with a friction that the twin states counts where it slides (`slides`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.closed_loop.channels import Channel, chance_rms, position_rms, session_rms
from gap_diagnosis.closed_loop.dither import sticks
from gap_diagnosis.closed_loop.slides import slides, sliding
from gap_diagnosis.evidence import judgement as judge
from gap_diagnosis.evidence.acceptance import FAR, Sides, far_from_explained
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import scored_ticks
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile
from stage_twin.effects import link_of

if TYPE_CHECKING:
    from gap_diagnosis.passes import Prepared


def far(
    records: list[Record],
    prepared: Prepared,
    swinging: Collection[str],
    channels: Mapping[str, Channel],
    effects: dict[str, dict[str, float]],
    told: dict[str, dict[str, float]],
    speeds: dict[str, float],
) -> bool:
    """Whether the positions are left far from explained; rests scatter by themselves.

    `swinging` names effects that swing, `effects` are all that are named, `told` those with
    which the loop is run, and `speeds` those at the tracker's points [m/s].
    """
    # The gap of an axis that swings at a phase of its own stays.
    out = {name[-1] for name in swinging}
    calm = {n: c for n, c in channels.items() if c.unit == 'm' and n[-1] not in out}
    if not calm or prepared.twin.kind == 'stepper':
        return False
    encoders = [n[-1] for n in calm if n.startswith('encoder')]
    sliding = [a for a in encoders if slides(records, prepared.twin, a)]
    if any(_far_sliding(records, prepared, axis, told) for axis in sliding):
        return True
    calm = {n: c for n, c in calm.items() if n not in {f'encoder.{a}' for a in sliding}}
    if sliding and not any(n.startswith('encoder') for n in calm):
        return False  # what the tracker shows beside the encoder, its own residual tells
    return _far_at_all(records, prepared, calm, effects, told, speeds)


def _far_at_all(
    records: list[Record],
    prepared: Prepared,
    calm: dict[str, Channel],
    effects: dict[str, dict[str, float]],
    told: dict[str, dict[str, float]],
    speeds: dict[str, float],
) -> bool:
    """The same of some channels together, wherever their axes go."""
    before, after = position_rms(calm, 'before'), position_rms(calm, 'after')
    floor = judge.noise_floor(prepared.seen, calm, effects, speeds)
    encoders = {n: c for n, c in calm.items() if n.startswith('encoder')}
    axes = [name[-1] for name in encoders]
    whole = session_rms(records, prepared.twin, told, axes)
    step = judge.noise_floor(prepared.seen, encoders, effects, speeds) if encoders else floor
    chance = chance_rms(records, prepared.twin, told, axes)
    share = math.sqrt(len(encoders) / len(calm))
    floor, step = math.hypot(floor, chance * share), math.hypot(step, chance)
    stated = _without_stated(records, prepared.twin, axes)
    return far_from_explained(
        before, after, floor, bool(effects), share * stated
    ) or far_from_explained(*whole, step, bool(effects), stated)


def _far_sliding(
    records: list[Record], prepared: Prepared, axis: str, told: dict[str, dict[str, float]]
) -> bool:
    """The same of one axis where it slides."""
    rows = [sliding(record, prepared.twin, axis) for record in records]
    before, after = session_rms(records, prepared.twin, told, [axis], rows)
    named = any(link_of(n) == 'servo' and split_effect(n)[1] == axis for n in told)
    # With `stated` above zero the limit is that beside a stated friction.
    return far_from_explained(before, after, _noise(records, prepared, axis, told), named, before)


def _noise(
    records: list[Record], prepared: Prepared, axis: str, told: dict[str, dict[str, float]]
) -> float:
    """Floor of an encoder together with what chance makes of its loop [m]."""
    step = judge.channel_floor(prepared.seen, f'encoder.{axis}')
    late = told.get('sample_jitter', {}).get('std', 0.0) * _speed(records, axis)
    return math.hypot(step, late, chance_rms(records, prepared.twin, told, [axis]))


@dataclass(frozen=True)
class Sliding:
    """Of the held-out rows of each record those at which an axis slides, and what is noise there.

    Attributes
    ----------
    rows : of each record (n,)
    noise : floor of the encoder together with what chance makes of its loop [m]
    """

    rows: list[NDArray[np.bool_]]
    noise: float

    def is_noise(self, sides: Sides) -> bool:
        """Whether the gap with all effects is noise alone."""
        return float(np.mean(sides.with_it)) < (FAR * self.noise) ** 2


def sliding_axes(
    scored: list[Record], prepared: Prepared, told: dict[str, dict[str, float]]
) -> dict[str, Sliding]:
    """What is told where an axis slides, by the channels of such axes."""
    twin = prepared.twin
    out: dict[str, Sliding] = {}
    for axis in scored[0].axes:
        if slides(scored, twin, axis):
            rows = [sliding(r, twin, axis)[scored_ticks(r)] for r in scored]
            out[f'encoder.{axis}'] = Sliding(rows, _noise(scored, prepared, axis, told))
    return out


def grown_notes(channels: Mapping[str, Channel], slides: Mapping[str, Sliding]) -> list[str]:
    """What a reader has to know where a whole gap grows with effects that are right."""
    out = []
    for name, own in slides.items():
        channel = channels[name]
        if channel.rms('after') > channel.rms('before'):
            sides = channel.sides(own.noise, rows=own.rows)
            whole, there = (
                f'from {1e6 * before:.3g} to {1e6 * after:.3g} µm'
                for before, after in (
                    (channel.rms('before'), channel.rms('after')),
                    (math.sqrt(np.mean(sides.without)), math.sqrt(np.mean(sides.with_it))),
                )
            )
            out.append(
                f'{name}: with the effects its whole gap goes {whole}, because the friction that '
                "the twin states has another law before the axis slides than the machine's. "
                f'Where the axis slides, the gap goes {there}'
            )
    return out


def _speed(records: Sequence[Record], axis: str) -> float:
    """RMS of the reference's speed [m/s]."""
    speeds = [np.nan_to_num(r.reference_velocity[:, r.column(axis)]) for r in records]
    return float(np.sqrt(np.mean(np.concatenate(speeds) ** 2)))


def _without_stated(records: list[Record], twin: TwinFile, axes: Sequence[str]) -> float:
    """RMS [m] of the encoders' gap without frictions that the twin states; 0 without."""
    kept = {n: v for n, v in twin.effects.items() if not sticks([n])}
    if len(kept) == len(twin.effects):
        return 0.0
    without, _ = session_rms(records, replace(twin, effects=kept), {}, axes)
    # A loop that runs away without them tells nothing of them.
    travel = max(float(np.ptp(r.reference, axis=0).max()) for r in records)
    return without if without < travel else 0.0
