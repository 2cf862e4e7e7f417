"""Waves over the position: the parameters of their sum, and the sum."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numba.extending import register_jitable

from stage_core.arrays import Array
from stage_twin.effects.definition import Parameter
from stage_twin.effects.shared import CENTRE, HALF_RANGE, screw_angle

Angles = TypeVar('Angles', float, Array)
"""One or many."""

HARMONICS = 4
WAVES = 4  # of periods of their own, beside the first and its harmonics

#: How the amplitude changes along the travel; centre and half_range say where that is.
GROWTH = (
    Parameter(
        'growth', '', -1.0, 1.0, 0.0, 'of the amplitude, middle to end of the travel', neutral=None
    ),
    CENTRE,
    HALF_RANGE,
)


def harmonic_parameters(unit: str, largest: float) -> tuple[Parameter, ...]:
    """Amplitudes and phases of the harmonics above the first."""
    kinds = (
        ('amplitude', unit, 0.0, largest, 0.0, False),
        ('phase', 'rad', -6.2831854, 6.2831854, None, True),
    )
    return tuple(
        Parameter(f'{kind}_{k}', of, low, high, 0.0, f'of harmonic {k}', neutral, nuisance)
        for kind, of, low, high, neutral, nuisance in kinds
        for k in range(2, HARMONICS + 1)
    )


def wave_parameters(unit: str, largest: float) -> tuple[Parameter, ...]:
    """Amplitudes, periods and phases of waves whose periods are their own (magnets and slots)."""
    shape = ('of wave {}', None)
    kinds = (
        ('amplitude', unit, 0.0, largest, False, ('of a wave of another period', 0.0)),
        ('period', 'm', 0.0, 20.0, False, shape),
        ('phase', 'rad', -6.2831854, 6.2831854, True, shape),
    )
    return tuple(
        Parameter(f'wave_{kind}{k}', of, low, high, 0.0, said[0].format(k), said[1], nuisance)
        for kind, of, low, high, nuisance, said in kinds
        for k in range(1, WAVES + 1)
    )


@register_jitable  # in Python it takes arrays, too
def wave(
    angle: Angles, amplitude: float, phase: float, amplitude_: Array, phase_: Array
) -> Angles:
    """Sum of the harmonics at an angle [rad] of the first, in the amplitudes' unit.

    `amplitude_` and `phase_` hold those from the second on.
    """
    total = amplitude * np.sin(angle + phase)
    for k in range(len(amplitude_)):
        if amplitude_[k] != 0.0:
            total += amplitude_[k] * np.sin((k + 2.0) * angle + phase_[k])
    return total


@register_jitable  # in Python it takes arrays, too
def grown(position: Angles, growth: float, centre: float, half_range: float) -> Angles:
    """Factor of an amplitude at a position [m]; 1 in the middle of the travel."""
    return 1.0 + growth * np.minimum(np.maximum((position - centre) / half_range, -1.0), 1.0)


@register_jitable
def more_waves(
    position: float, amplitude: Array, period: Array, phase: Array, lead: float
) -> float:
    """Sum at a position [m] of waves whose periods [m] are their own, in the amplitudes' unit."""
    total = 0.0
    for k in range(len(amplitude)):
        if amplitude[k] != 0.0:
            total += amplitude[k] * math.sin(screw_angle(position, period[k], lead) + phase[k])
    return total
