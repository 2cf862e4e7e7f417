"""Force over position with a period: cogging and commutation."""

from __future__ import annotations

from collections.abc import Callable

from stage_core.arrays import Array
from stage_twin.effects import periodic, waveform
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.shared import PERIOD, PHASE, screw_angle
from stage_twin.effects.term import Term

EFFECT = Effect(
    name='force_ripple',
    link='servo',
    parameters=(
        Parameter('amplitude', 'N', 0.0, 1000.0, 2.0, 'amplitude'),
        PERIOD,
        PHASE,
        *waveform.harmonic_parameters('N', 1000.0),
        *waveform.GROWTH,
        *waveform.wave_parameters('N', 1000.0),
    ),
    model='Force amplitude * sin(2 pi p / period + phase) on the moving mass, harmonics, a growth '
    'of both along the travel, and waves of other periods: cogging and commutation. Jahns and '
    'Soong, "Pulsating torque minimization techniques for permanent magnet AC motor drives", IEEE '
    'Trans. Industrial Electronics 43 (1996).',
    sentence='the drive force ripples over position by {amplitude}',
    excited_by='slow strokes over whole periods of the motor',
    by_shape=True,
    along_travel=True,
)


def force(
    position: float,
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
    """Force on the moving mass [N]."""
    total = waveform.wave(
        screw_angle(position, period, lead),
        amplitude,
        phase,
        amplitude_,
        phase_,
    )
    total *= waveform.grown(position, growth, centre, half_range)
    return total + waveform.more_waves(position, wave_amplitude, wave_period, wave_phase, lead)


def term(rows: ForceRows) -> Term:
    """Sine and cosine of each harmonic; θ is the spatial frequency [1/m]."""
    path = rows.used(rows.position())

    def columns(waves: Callable[[Array], list[Array]]) -> Array:
        sessions = [waves(p) for p in rows.position()]
        signals = [[-wave for wave in same] for same in zip(*sessions, strict=True)]
        return periodic.visible(rows.columns(*signals))

    low, high = periodic.bounds(path, rows.lead)
    told = periodic.own_or_turning(path, rows.lead)
    plain = Term(
        lambda theta: columns(lambda p: periodic.waves(p, theta[0])),
        lambda theta, c: periodic.found(theta, c),
        grid=((low,),),
        propose=periodic.starts(path, (1.0 / rows.lead, 2.0 / rows.lead), rows.lead),
        lower=(low,),
        upper=(high,),
        # A force of the position is a curve like any other before it is a slow wave.
        usual=lambda theta: told(theta[0]),
    )
    return periodic.along_the_travel(plain, columns, path, rows.lead)
