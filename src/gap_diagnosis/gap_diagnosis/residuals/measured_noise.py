"""The twin with the noise that the records really have, where it is above the stated one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gap_diagnosis.input.data import Record
from gap_diagnosis.input.noise import CLEARLY_NOISIER
from gap_diagnosis.parameters import Parameters
from stage_core.twin_file import TwinFile


def with_steps(twin: TwinFile, quantisation: Parameters) -> TwinFile:
    """The twin with the encoder steps that the records really have: they are a noise floor."""
    axes = dict(twin.axes)
    for name, values in quantisation.items():
        axis = name[-1]
        axes[axis] = replace(axes[axis], encoder_resolution=values['resolution'][0])  # type: ignore[arg-type]
    return replace(twin, axes=axes)


def with_noise(twin: TwinFile, records: list[Record]) -> TwinFile:
    """The twin with the noise that the records really have, where it is above what it states.

    An encoder's noise is stated as the step of an ideal one that makes as much.
    """
    axes = dict(twin.axes)
    for i, axis in enumerate(records[0].axes):
        noise = encoder_noise(records, i)
        if noise * math.sqrt(12.0) > getattr(axes[axis], 'encoder_resolution', math.inf):
            axes[axis] = replace(axes[axis], encoder_resolution=noise * math.sqrt(12.0))  # type: ignore[arg-type]
    tracker = twin.tracker
    seen = [r.noise.tracker for r in records if r.noise and r.noise.tracker is not None]
    if seen and tracker is not None:
        noise = float(np.sqrt(np.mean(np.square(seen))))
        # The measured figure of a record has a scatter of its own.
        if noise > CLEARLY_NOISIER * tracker.noise:
            tracker = replace(tracker, noise=noise)
    return replace(twin, axes=axes, tracker=tracker)


def encoder_noise(records: list[Record], i: int) -> float:
    """Measured noise [m] of the encoder of an axis over all ticks; 0 where it is not known."""
    known = [r.noise.axes[i].std(np.diff(r.encoder[:, i]) / r.period) for r in records if r.noise]
    return float(np.sqrt(np.mean(np.square(known)))) if known else 0.0


def with_mean_points(twin: TwinFile, records: list[Record]) -> TwinFile:
    """The twin with the noise that the rows really have: the mean of a rest's tracker points.

    A twin that states its `repeatability` [m] has the scatter of the rests in it (R = 4 s,
    ISO 230-2).
    """
    means = [r.row_noise for r in records if r.row_noise is not None]
    if len(means) < len(records) or twin.tracker is None:
        return twin
    noise = max(means)
    scatter = rest_scatter(twin, records)
    if scatter is not None:
        noise = math.hypot(noise, scatter)
    return replace(twin, tracker=replace(twin.tracker, noise=noise))


def rest_scatter(twin: TwinFile, records: list[Record]) -> float | None:
    """Standard deviation of where a rest is [m]: of repeated rests, else what the twin states.

    None where neither is known.
    """
    measured = [r.rest_scatter for r in records if r.rest_scatter is not None]
    if measured:
        return float(np.sqrt(np.mean(np.square(measured))))
    return None if twin.repeatability is None else 0.25 * twin.repeatability
