"""Error of the encoder within each period of its scale."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects import periodic, waveform
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import TrackerRows
from stage_twin.effects.shared import PHASE
from stage_twin.effects.term import Term, Theta

#: Signal periods of encoders [m]: of interferential scales, and of photoelectric ones seen through
#: a mask (0.2 to 0.5 mm where they are coarse). Longer ones are rather those of screws and
#: couplings, and of magnetic scales, whose poles are 1 and 2 mm wide.
SHORTEST, USUAL, LONGEST = 2e-6, 0.6e-3, 3e-3
#: Periods in the travel, below which a wave is no property of the scale.
TRAVELLED = 10.0
#: Noise of the encoder, as a step, that a period must hold: its phase is lost in more.
STEPS = 4.0
#: Of such steps in a period, from which on their noise in the wave's argument takes under 0.5 %
#: of the amplitude. The low-pass that keeps it out would change a wave that is not small.
CLEAR = 18.0
FINE = 8  # bins of a periodogram in the shortest period
#: Shares of a turn over the travel: between two frequencies of a periodogram, and of a search.
PAD, SEARCH = 4, 40
PEAKS = 3
POINTS = 60  # of a period, over which a wave is turned from the reading into the position

EFFECT = Effect(
    name='encoder_interpolation',
    link='sensor',
    parameters=(
        Parameter('amplitude', 'm', 0.0, 200e-6, 0.5e-6, 'amplitude'),
        Parameter(
            'period',
            'm',
            1e-6,
            LONGEST,
            20e-6,
            "signal period of the encoder's scale",
            neutral=None,
            scanned=True,
        ),
        PHASE,
        *waveform.harmonic_parameters('m', 200e-6),
    ),
    model='The encoder reads p + amplitude * sin(2 pi p / period + phase), and harmonics: offset, '
    'amplitude and phase errors of its two signals. Heydemann, "Determination and correction of '
    'quadrature fringe measurement errors in interferometers", Applied Optics 20 (1981).',
    sentence='the encoder reads falsely by {amplitude} within each {period} of its scale',
    excited_by='strokes of many speeds over some periods of the scale; slow ones with the tracker',
)


def read(
    position: waveform.Angles,
    amplitude: float,
    period: float,
    phase: float,
    amplitude_: Array,
    phase_: Array,
) -> waveform.Angles:
    """What the encoder reads at a motor position [m], or at many of them."""
    return position + waveform.wave(
        2.0 * math.pi * position / period,
        amplitude,
        phase,
        amplitude_,
        phase_,
    )


def misreading(position: Array, values: Mapping[str, float]) -> Array:
    """What an encoder reads too much (n,) [m] at motor positions (n,) [m]."""
    own = {**EFFECT.defaults(), **values}
    higher = [
        np.array([own[f'{kind}_{k}'] for k in range(2, waveform.HARMONICS + 1)])
        for kind in ('amplitude', 'phase')
    ]
    return read(position, own['amplitude'], own['period'], own['phase'], *higher) - position


def term(rows: TrackerRows) -> Term | None:
    """What the encoder reads too much, sampled as it is; θ is the spatial frequency [1/m]."""
    travel = 2.0 * rows.travel[1]
    low = max(1.0 / LONGEST, TRAVELLED / travel)
    high = 1.0 / max(SHORTEST, STEPS * rows.step)
    if rows.rests or low >= high:
        return None
    paths, readings = rows.calm_encoder(), rows.reading()
    own = rows.along([np.ones(len(p)) for p in rows.position()])[:, 0] > 0.0

    def columns(harmonics: int, theta: Theta) -> Array:
        read = readings if 1.0 / theta[0] > CLEAR * rows.step else paths
        waves = [np.column_stack(periodic.waves(p, theta[0], harmonics)) for p in read]
        return -rows.along(rows.smooth_at_points(waves))

    def propose(residual: Array) -> tuple[Theta, ...]:
        spread = np.concatenate(rows.at_ticks(residual[own]))
        at = spread != 0.0
        return peaks(np.concatenate(paths)[at], spread[at], low, high)

    plain = Term(
        partial(columns, 1),
        _parameters,
        grid=((low,),),
        propose=propose,
        lower=(low,),
        upper=(high,),
        admissible=lambda theta, c: bool(np.max(np.abs(c)) < 0.25 / theta[0]),
        steps=(0.02 / travel,),
        usual=lambda theta: theta[0] > 1.0 / USUAL,
    )
    return periodic.with_harmonics(plain, columns)


def behind(reading: Array, theta: Theta, c: Array) -> Array:
    """Motor positions (n,) [m] behind what an encoder reads, with the wave of a fitted term."""
    waves = periodic.waves(reading, theta[0], len(c) // 2)
    return np.asarray(reading - np.column_stack(waves) @ c)


def _parameters(theta: Theta, c: Array) -> dict[str, float]:
    """Parameters of the wave over the position; the term has it over the reading.

    A wave that is no small part of its period is another one over each of the two.
    """
    reading = np.linspace(0.0, 1.0 / theta[0], POINTS, endpoint=False)
    position = behind(reading, theta, c)
    matrix = np.column_stack([*periodic.waves(position, theta[0]), np.ones(POINTS)])
    over, *_ = np.linalg.lstsq(matrix, reading - position, rcond=None)
    return periodic.found(theta, np.asarray(over[:-1], dtype=np.float64))


def peaks(position: Array, values: Array, low: float, high: float) -> tuple[Theta, ...]:
    """Spatial frequencies [1/m] of the highest peaks of values (n,) over their positions (n,).

    A Fourier transform over fine bins of the position finds them, direct sums place them.
    """
    start, bin_width = float(position.min()), 1.0 / (FINE * high)
    travel = float(np.ptp(position))
    power = np.bincount(((position - start) / bin_width).astype(np.int64), values)
    from scipy.fft import next_fast_len

    size = next_fast_len(PAD * len(power), real=True)
    power = np.abs(np.fft.rfft(power, size))
    frequencies = np.arange(len(power)) / (size * bin_width)
    power[(frequencies < low) | (frequencies > high)] = 0.0
    tops = np.flatnonzero((power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:])) + 1
    found = []
    for top in tops[np.argsort(-power[tops])][:PEAKS]:
        near = frequencies[top] + np.linspace(-1.0, 1.0, 2 * SEARCH // PAD + 1) / (PAD * travel)
        turned = values * np.exp(-2j * np.pi * near[0] * position)
        step, sums = np.exp(-2j * np.pi * (near[1] - near[0]) * position), []
        for _ in near:
            sums.append(abs(turned.sum()))
            turned *= step
        found.append((float(np.clip(near[np.argmax(sums)], low, high)),))
    return tuple(found) or ((low,),)
