"""Periods of a position that a residual shows, and the harmonics over one of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numba import njit

from stage_twin.effects.definition import Parameter
from stage_twin.effects.term import Array, Term, Theta

HARMONICS = 3
PERIODS = 200  # shortest period as a share of the travel: the low-pass leaves no finer one
ROWS = 6000  # rows of a periodogram; more tell no other peaks
PEAKS = 4


def harmonic_parameters(unit: str, largest: float) -> tuple[Parameter, ...]:
    """Amplitudes and phases of the harmonics above the first."""
    out = []
    for k in range(2, HARMONICS + 1):
        out.append(Parameter(f'amplitude_{k}', unit, 0.0, largest, 0.0, f'of harmonic {k}'))
        out.append(
            Parameter(
                f'phase_{k}',
                'rad',
                -6.2831854,
                6.2831854,
                0.0,
                f'of harmonic {k}',
                nuisance=True,
                neutral=None,
            )
        )
    return tuple(out)


@njit
def wave(
    angle: float,
    amplitude: float,
    phase: float,
    amplitude_2: float,
    phase_2: float,
    amplitude_3: float,
    phase_3: float,
) -> float:
    """Sum of the harmonics at an angle [rad] of the first, in the amplitudes' unit."""
    total = amplitude * math.sin(angle + phase)
    if amplitude_2 != 0.0:
        total += amplitude_2 * math.sin(2.0 * angle + phase_2)
    if amplitude_3 != 0.0:
        total += amplitude_3 * math.sin(3.0 * angle + phase_3)
    return total


def with_harmonics(
    plain: Term, columns: Callable[[int, Theta], Array], harmonics: int = 1
) -> Term:
    """A term of as many harmonics, richer by one each; `columns` takes their number and θ."""
    return replace(
        plain,
        columns=lambda theta: columns(harmonics, theta),
        nuisances=tuple(range(2 * harmonics)),
        phase=True,
        richer=(lambda: with_harmonics(plain, columns, harmonics + 1))
        if harmonics < HARMONICS
        else None,
    )


def bounds(position: Array) -> tuple[float, float]:
    """Least and largest spatial frequency [1/m] of a position (n,): one period is travelled."""
    travel = max(float(np.ptp(position)), 1e-9)
    return 1.0 / travel, PERIODS / travel


def starts(position: Array, favourites: tuple[float, ...]) -> Callable[[Array], tuple[Theta, ...]]:
    """Spatial frequencies at which a residual over the position (n,) has the highest peaks.

    `favourites` [1/m] (of the screw) are always among them. A periodogram for unevenly spaced
    samples: Lomb, Astrophysics and Space Science 39 (1976).
    """
    low, high = bounds(position)
    frequencies = np.arange(low, high, 0.25 * low)
    chosen = slice(None, None, max(1, len(position) // ROWS))
    turns = np.exp(-2j * np.pi * np.outer(frequencies, position[chosen]))

    def propose(residual: Array) -> tuple[Theta, ...]:
        kept = residual[chosen]
        power = np.abs(turns @ (kept - kept.mean()))
        inner = (power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:])
        peaks = np.flatnonzero(np.concatenate([[power[0] > power[1]], inner, [False]]))
        best = peaks[np.argsort(-power[peaks])][:PEAKS]
        known = [f for f in favourites if low <= f <= high]
        return tuple((float(f),) for f in (*known, *frequencies[best])) or ((low,),)

    return propose


def waves(position: Array, frequency: float) -> list[Array]:
    """Sine and cosine (n,) of each harmonic of a spatial frequency [1/m]."""
    angle = 2.0 * np.pi * frequency * position
    return [f(k * angle) for k in range(1, HARMONICS + 1) for f in (np.sin, np.cos)]


def found(frequency: float, coefficients: Array) -> dict[str, float]:
    """Parameters of an effect from its spatial frequency and the coefficients of `waves`."""
    out = {'period': 1.0 / frequency}
    for k in range(len(coefficients) // 2):
        sine, cosine = coefficients[2 * k : 2 * k + 2]
        suffix = f'_{k + 1}' if k else ''
        out[f'amplitude{suffix}'] = float(np.hypot(sine, cosine))
        out[f'phase{suffix}'] = float(np.arctan2(cosine, sine))
    return out


def visible(columns: Array, least: float = 0.2) -> Array:
    """Columns (n, k) of unit waves, those that a low-pass has all but taken away set to zero."""
    kept = np.sqrt(np.mean(columns**2, axis=0)) > least * np.sqrt(0.5)
    return np.asarray(columns * kept)
