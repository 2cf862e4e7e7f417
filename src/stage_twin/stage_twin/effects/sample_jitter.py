"""The stamps are not the times of the samples."""

from __future__ import annotations

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='sample_jitter',
    link='sensor',
    parameters=(
        Parameter(
            'std', 's', 0.0, 1e-3, 1e-4, "standard deviation of a tick's stamp about its sample"
        ),
        Parameter(
            'tracker_std',
            's',
            0.0,
            1e-2,
            0.0,
            "standard deviation of a tracker point's stamp about its sample",
        ),
    ),
    model='stamp = time of the sample + white noise. Souders et al., "The effects of timing '
    'jitter in sampling systems", IEEE Trans. Instrumentation and Measurement 39 (1990).',
    sentence='the stamps of the ticks are {std} off the times of their samples, those of the '
    'tracker {tracker_std}',
    excited_by='fast strokes',
    per_axis=False,
)


def tick_stamp(times: Array, std: float) -> Array:
    """Stamps (n,) [s] of ticks at some times [s], in order; the same for as many ticks."""
    noise = std * np.random.default_rng(len(times)).standard_normal(len(times))
    return np.asarray(np.maximum.accumulate(times + noise))


def point_stamp(times: Array, tracker_std: float) -> Array:
    """Stamps (m,) [s] of tracker points at some times [s], in order; the same for as many."""
    return tick_stamp(times, tracker_std)
