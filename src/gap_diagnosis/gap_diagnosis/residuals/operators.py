"""Filters and differences of recorded signals."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.signal import butter, lfilter, sosfiltfilt

Array = NDArray[np.float64]


def smooth(signal: Array, period: float, corner: float) -> Array:
    """Zero-phase low-pass 1 / (1 + (f / corner)²): a first-order filter forwards and backwards.

    Its roll-off of f⁻² makes the noise of a twice differentiated position white above the
    corner [Hz]. `signal` has shape (n,) or (n, k).
    """
    decay = math.exp(-2.0 * math.pi * corner * period)
    b, a = [1.0 - decay], [1.0, -decay]
    start = signal[:1] * decay
    forward = lfilter(b, a, signal, axis=0, zi=start)[0]
    end = forward[-1:] * decay
    return np.asarray(lfilter(b, a, forward[::-1], axis=0, zi=end)[0][::-1])


def second_difference(position: Array, period: float) -> Array:
    """Central second difference of a position (n,) [m/s²]; zero at both ends."""
    out = np.zeros_like(position)
    out[1:-1] = (position[2:] - 2.0 * position[1:-1] + position[:-2]) / period**2
    return out


def central_difference(position: Array, period: float) -> Array:
    """Central difference of a position (n,) [m/s]; zero at both ends."""
    out = np.zeros_like(position)
    out[1:-1] = (position[2:] - position[:-2]) / (2.0 * period)
    return out


def centred_hold(force: Array, delay_ticks: float = 0.0) -> Array:
    """Mean of a zero-order-held force over the two ticks around each stamp, delayed.

    For a double integrator the second difference of the position at tick k is exactly
    (F_k + F_(k-1)) / 2 over the mass; a delay of n + f ticks shifts the hold.
    """
    whole = int(math.floor(delay_ticks))
    part = delay_ticks - whole
    # Double integral of the hold over [-1, 1] ticks with the triangle (1 - |s|), shifted by part.
    weights = (
        0.5 * (1.0 - part) ** 2,
        0.5 + part * (1.0 - part),
        0.5 * part**2,
    )
    out = np.zeros_like(force)
    for lag, weight in enumerate(weights):
        out += weight * shifted(force, whole + lag)
    return out


def shifted(signal: Array, ticks: int) -> Array:
    """Signal (n,) later by whole ticks; its first value fills the start."""
    if ticks == 0:
        return signal
    return np.concatenate([np.full(ticks, signal[0]), signal[:-ticks]])


def band_limited(signal: Array, period: float, corner: float = 90.0) -> Array:
    """Zero-phase Butterworth low-pass (n,) or (n, k), flat to about 0.8 of the corner [Hz].

    Keeps the encoder's noise out of a regressor that the target shares it with.
    """
    return np.asarray(sosfiltfilt(_sections(min(2.0 * corner * period, 0.9)), signal, axis=0))


@lru_cache
def _sections(corner: float) -> Array:
    return np.asarray(butter(4, corner, output='sos'))


@njit(cache=True)
def sure_turns(position: Array, step: float) -> Array:
    """Position (n,) without turns that the counts of an encoder [m a step] can imitate.

    Where the motion creeps about the edge of a count, the encoder turns back by a step. So the
    path stays at its furthest point until the encoder is 1.5 steps away from it.
    """
    out = np.empty(len(position))
    furthest, direction = position[0], 0.0
    for k in range(len(position)):
        away = position[k] - furthest
        if away * direction > 0.0:
            furthest = position[k]
        elif abs(away) > 1.5 * step:
            furthest, direction = position[k], math.copysign(1.0, away)
        out[k] = furthest
    return out
