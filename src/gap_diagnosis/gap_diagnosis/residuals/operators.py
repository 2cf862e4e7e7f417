"""Filters and differences of recorded signals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import spline_filter1d
from scipy.signal import butter, sosfilt_zi

Array = NDArray[np.float64]

#: Added to what a recursive filter takes in: after an input of zeros its state fades below what a
#: processor computes at full speed (2e-308), and each later step takes twelve times as long.
TINY = 1e-100
PADDING = 15  # rows by which a signal is mirrored at its ends, as SciPy does for two sections


def smooth(signal: Array, period: float, corner: float) -> Array:
    """Zero-phase low-pass 1 / (1 + (f / corner)²): a first-order filter forwards and backwards.

    Its roll-off of f⁻² makes the noise of a twice differentiated position white above the
    corner [Hz]. `signal` has shape (n,) or (n, k).
    """
    out = np.array(signal, dtype=np.float64, order='C')
    _both_ways(out.reshape(len(out), -1), math.exp(-2.0 * math.pi * corner * period))
    return out


@njit(cache=True, fastmath={'contract'})
def _both_ways(columns: Array, decay: float) -> None:
    """Smooth columns (n, k) in place, forwards and then backwards, each from its first value."""
    new, (count, width) = 1.0 - decay, columns.shape
    for i in range(1, count):
        for j in range(width):
            columns[i, j] = decay * columns[i - 1, j] + (new * columns[i, j] + TINY)
    for i in range(count - 2, -1, -1):
        for j in range(width):
            columns[i, j] = decay * columns[i + 1, j] + (new * columns[i, j] + TINY)


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

    Keeps the encoder's noise out of a regressor that the target shares it with. It is SciPy's
    `sosfiltfilt`, compiled for all columns at once.
    """
    sections, start = _sections(min(2.0 * corner * period, 0.9))
    before, after = signal[PADDING:0:-1], signal[-2 : -PADDING - 2 : -1]
    padded = np.concatenate([2.0 * signal[:1] - before, signal, 2.0 * signal[-1:] - after])
    _pass_sections(padded.reshape(len(padded), -1), sections, start)
    return padded[len(before) : len(before) + len(signal)]


@lru_cache
def _sections(corner: float) -> tuple[Array, Array]:
    """Two second-order sections (2, 6) and their states (2, 2) at rest on a one."""
    sections = np.asarray(butter(4, corner, output='sos'))
    return sections, np.asarray(sosfilt_zi(sections))


@njit(cache=True, fastmath={'contract'})
def _pass_sections(columns: Array, sections: Array, start: Array) -> None:
    """Filter columns (n, k) in place, forwards and then backwards, each from its first value."""
    b0, b1, b2, _, a1, a2 = sections[0]
    d0, d1, d2, _, c1, c2 = sections[1]
    count, width = columns.shape
    state = np.empty((4, width))
    for step in (1, -1):
        begin, end = (0, count) if step > 0 else (count - 1, -1)
        for k in range(4):
            state[k] = start[k // 2, k % 2] * columns[begin]
        for i in range(begin, end, step):
            for j in range(width):
                u = columns[i, j] + TINY
                v = b0 * u + state[0, j]
                state[0, j] = (b1 * u + state[1, j]) - a1 * v
                state[1, j] = b2 * u - a2 * v
                w = d0 * v + state[2, j]
                state[2, j] = (d1 * v + state[3, j]) - c1 * w
                state[3, j] = d2 * v - c2 * w
                columns[i, j] = w


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
