"""Where the gap lies: its share by condition, with significance against shuffled blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.input.data import Record
from gap_diagnosis.residuals.low_pass import smooth
from gap_diagnosis.residuals.operators import central_difference, second_difference
from stage_core.arrays import Array
from stage_core.twin_file import TwinFile
from stage_twin.effects.friction import presliding_state

if TYPE_CHECKING:
    from gap_diagnosis.selection.parts import Part

PERMUTATIONS = 199


@dataclass(frozen=True)
class Condition:
    """Share of a channel's gap that goes with a condition, and how likely by chance."""

    name: str
    axis: str
    link: str
    share: float
    p_value: float


def features(
    record: Record, axis: str, time: Array, lead: float, reference_temperature: float
) -> dict[str, Array]:
    """Basis (m, k) of each condition at some times [s] of a session."""
    i = record.column(axis)
    p = smooth(record.encoder[:, i], record.period, 60.0)
    v = central_difference(p, record.period)
    a = second_difference(p, record.period)

    def at(signal: Array) -> Array:
        return np.interp(time, record.time, signal)

    half = max(0.5 * float(np.ptp(p)), 1e-6)
    s = (at(p) - float(p.min()) - half) / half
    phase = 2.0 * np.pi * at(p) / lead
    out = {
        'reversal': np.column_stack([at(presliding_state(p, g)) for g in (2e-6, 20e-6)]),
        'position': np.column_stack([s, 1.5 * s**2 - 0.5, 2.5 * s**3 - 1.5 * s]),
        'screw_phase': np.column_stack(
            [np.sin(phase), np.cos(phase), np.sin(2 * phase), np.cos(2 * phase)]
        ),
        'speed': np.column_stack([at(v), np.abs(at(v))]),
        'acceleration': at(a)[:, None],
        'time': np.column_stack([time, time**2]),
    }
    if record.temperature is not None and np.ptp(record.temperature[:, i]) > 0.2:
        rise = at(record.temperature[:, i]) - reference_temperature
        out['temperature'] = np.column_stack([rise, rise * s])
    if len(record.axes) == 2 and record.moving[1 - i]:
        q = smooth(record.encoder[:, 1 - i], record.period, 60.0)
        u = (at(q) - float(q.mean())) / max(0.5 * float(np.ptp(q)), 1e-6)
        out['cross_axis'] = np.column_stack([u, u**2, at(presliding_state(q, 20e-6))])
    return out


def conditions(
    residual: Array,
    bases: dict[str, Array],
    block: NDArray[np.int64],
    axis: str,
    link: str,
    seed: int,
) -> list[Condition]:
    """Share and p-value of each condition for a residual (m,), the most telling first.

    The null shifts the blocks of the residual against the conditions, so that its
    autocorrelation within a block stays as it is.
    """
    generator = np.random.default_rng(seed)
    target = residual - residual.mean()
    total = float(target @ target) or 1.0
    starts = np.flatnonzero(np.diff(block, prepend=block[0] - 1))
    pieces = np.split(np.arange(len(target)), starts[1:])
    orders = [
        np.concatenate([pieces[j] for j in generator.permutation(len(pieces))])
        for _ in range(PERMUTATIONS)
    ]
    found = []
    for name, basis in bases.items():
        orthonormal, _ = np.linalg.qr(basis - basis.mean(axis=0))
        share = float(np.sum((orthonormal.T @ target) ** 2)) / total
        null = np.array([np.sum((orthonormal.T @ target[order]) ** 2) for order in orders]) / total
        p_value = (1.0 + np.count_nonzero(null >= share)) / (1.0 + len(null))
        found.append(Condition(name, axis, link, share, float(p_value)))
    found.append(_frequency(target, axis, link))
    return sorted(found, key=lambda c: (-(c.share if c.p_value < 0.05 else 0.0), c.p_value))


def _frequency(target: Array, axis: str, link: str) -> Condition:
    """Largest line of the spectrum; p-value of Fisher's g test (Proc. R. Soc. A 125, 1929)."""
    power = np.abs(np.fft.rfft(target)[1:]) ** 2
    # The slow half of the spectrum belongs to the other conditions.
    power = power[len(power) // 4 :]
    if len(power) < 3 or power.sum() <= 0.0:
        return Condition('frequency_band', axis, link, 0.0, 1.0)
    g = float(power.max() / power.sum())
    p_value = min(1.0, len(power) * (1.0 - g) ** (len(power) - 1))
    share = float(power.max() / np.sum(np.abs(np.fft.rfft(target)[1:]) ** 2))
    return Condition('frequency_band', axis, link, share, p_value)


def conditions_of(
    scored: list[Record], records: list[Record], twin: TwinFile, parts: Sequence[Part], seed: int
) -> list[Condition]:
    """Conditions of the gap in every part, the surest and largest first."""
    found: list[Condition] = []
    for part in parts:
        for i, axis in enumerate(records[0].axes):
            # One session's bags at a time: the conditions are functions of its own time.
            rows = (part.row_axis == i) & (part.problem.record == 0)
            if not rows.any():
                continue
            excess = float(np.mean(part.problem.gap[rows] ** 2)) - part.problem.floor**2
            if excess < 0.5 * part.problem.floor**2:
                continue
            record = records[0]
            time = part.problem.time[rows]
            step = max(1, len(time) // 6000)
            lead = float(getattr(twin.axes[axis], 'lead', 0.01))
            bases = features(record, axis, time[::step], lead, twin.temperature_reference)
            link = 'servo' if part.name.startswith('servo') else 'kinematic'
            found += conditions(
                part.problem.gap[rows][::step],
                bases,
                part.problem.block[rows][::step],
                axis,
                link,
                seed,
            )
    return sorted(found, key=lambda c: (c.p_value >= 0.05, -c.share))
