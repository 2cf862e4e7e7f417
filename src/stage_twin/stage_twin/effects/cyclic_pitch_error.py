"""Wobble and eccentricity of the screw."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects import periodic, waveform
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.encoder_interpolation import USUAL
from stage_twin.effects.rows import TrackerRows
from stage_twin.effects.shared import PERIOD, PHASE, screw_angle
from stage_twin.effects.term import Term, Theta

#: Waves are no sines: of four right amplitudes of foreign simulators one missed by 3.8 %, the
#: others by 0.9 % at most.
DOUBT = 0.015

EFFECT = Effect(
    name='cyclic_pitch_error',
    link='kinematic',
    parameters=(
        Parameter('amplitude', 'm', 0.0, 200e-6, 3e-6, 'amplitude', doubt=DOUBT),
        PERIOD,
        PHASE,
        *waveform.harmonic_parameters('m', 200e-6),
        *waveform.GROWTH,
        *waveform.wave_parameters('m', 200e-6),
    ),
    model='amplitude * sin(2 pi p / period + phase) along the axis, harmonics, a growth of '
    'both along the travel, and waves of other periods: wobble and eccentricity of '
    'the screw. ISO 230-2:2014, intra-pitch deviation; Slocum, "Precision machine design" (1992).',
    sentence='the table swings by {amplitude} with each turn of the screw',
    excited_by='positions within several turns of the screw',
    by_shape=True,
)


def along(
    motor: float,
    amplitude: float,
    period: float,
    phase: float,
    amplitude_: Array,
    phase_: Array,
    growth: float,
    centre: float,
    half_range: float,
    wave_amplitude: Array,
    wave_period: Array,
    wave_phase: Array,
    lead: float,
) -> float:
    """Displacement of the table along the axis [m]."""
    total = waveform.grown(motor, growth, centre, half_range) * waveform.wave(
        screw_angle(motor, period, lead),
        amplitude,
        phase,
        amplitude_,
        phase_,
    )
    return total + waveform.more_waves(motor, wave_amplitude, wave_period, wave_phase, lead)


def term(rows: TrackerRows) -> Term | None:
    """Sine and cosine; θ is the spatial frequency [1/m], that of the screw where rests are few."""
    path = np.concatenate(rows.position())
    low, high = periodic.bounds(path)
    high = min(high, 1.0 / USUAL)
    if rows.rests:
        return Term(
            lambda theta: _columns(rows, 1, (1.0 / rows.lead,)),
            lambda theta, c: periodic.found((1.0 / rows.lead,), c),
            admissible=_small,
            nuisances=(0, 1),
            phase=True,
        )
    if low >= high:
        return None
    own = rows.along([np.ones(len(p)) for p in rows.position()])[:, 0] > 0.0
    peaks = periodic.starts(path, (1.0 / rows.lead, 2.0 / rows.lead))
    often = periodic.own_or_turning(path, rows.lead)
    told = periodic.own_or_turning(path, rows.lead, periodic.FEW_TURNS)

    def propose(residual: Array) -> tuple[Theta, ...]:
        left = residual[own]
        found = tuple(f for f in peaks(left) if often(f[0]) or periodic.repeats(path, f[0], left))
        return found or ((low,),)

    whole = Term(
        partial(_columns, rows, 1),
        lambda theta, c: periodic.found(theta, c),
        grid=((low,),),
        propose=propose,
        lower=(low,),
        upper=(high,),
        admissible=lambda theta, c: _small(theta, c) and told(theta[0]),
        steps=(periodic.PHASE_STEP * low,),
    )
    columns = partial(_columns, rows)
    richest = periodic.along_the_travel(whole, partial(_along, rows), path, rows.lead, own)
    return periodic.with_harmonics(whole, columns, richest)


def _columns(rows: TrackerRows, harmonics: int, theta: Theta) -> Array:
    return _along(rows, lambda p: periodic.waves(p, theta[0], harmonics))


def _along(rows: TrackerRows, waves: Callable[[Array], list[Array]]) -> Array:
    return rows.along([np.column_stack(waves(p)) for p in rows.position()])


def _small(theta: Theta, c: Array) -> bool:
    return float(np.max(np.abs(c))) < 200e-6
