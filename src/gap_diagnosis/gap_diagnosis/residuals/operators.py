"""Differences and interpolation of recorded signals."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import spline_filter1d

from stage_core.arrays import Array


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


@dataclass(frozen=True)
class Spline:
    """Cubic spline of any signal of evenly spaced ticks, at places (m,) that stay.

    Attributes
    ----------
    ticks, weights : coefficients of the spline that count at each place, and their weights (m, 4)
    """

    ticks: NDArray[np.int64]
    weights: Array

    @classmethod
    def at(cls, place: Array, count: int) -> Spline:
        """The spline at places counted in ticks from the first of `count`."""
        before = np.clip(np.floor(place).astype(np.int64), 0, count - 2)
        u = (place - before)[:, None]
        weights = np.hstack(
            [(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, 1 + 3 * u + 3 * u**2 - 3 * u**3, u**3]
        )
        ticks = np.abs(before[:, None] + np.arange(-1, 3))
        return cls(np.where(ticks < count, ticks, 2 * (count - 1) - ticks), weights / 6.0)

    def __call__(self, signal: Array) -> Array:
        """A signal (n, k) of the ticks at the places (m, k)."""
        coefficients = spline_filter1d(signal, axis=0, mode='mirror')
        return np.einsum('mt,mt...->m...', self.weights, coefficients[self.ticks])


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
