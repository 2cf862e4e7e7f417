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
    decay = math.exp(-2.0 * math.pi * corner * period)
    columns = np.array(np.transpose(signal), dtype=np.float64, order='C')
    for column in columns.reshape(-1, len(signal)):
        _both_ways(column, decay)
    return columns.T


@njit(cache=True, fastmath={'contract'})
def _both_ways(column: Array, decay: float) -> None:
    """Smooth a column (n,) in place, forwards and then backwards, each from its first value."""
    new, value = 1.0 - decay, column[0]
    for i in range(1, len(column)):
        value = decay * value + (new * column[i] + TINY)
        column[i] = value
    for i in range(len(column) - 2, -1, -1):
        value = decay * value + (new * column[i] + TINY)
        column[i] = value


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
    `sosfiltfilt`, compiled for one column after the other: what they are in at a time stays near
    the processor.
    """
    sections, start = _sections(min(2.0 * corner * period, 0.9))
    out = np.empty(np.shape(signal)[::-1])
    columns = np.transpose(signal).reshape(-1, len(signal))
    for column, limited in zip(columns, out.reshape(columns.shape), strict=True):
        limited[:] = _limited(column, sections, start)
    return out.T


def _limited(column: Array, sections: Array, start: Array) -> Array:
    first, last = 2.0 * column[0], 2.0 * column[-1]
    before, after = column[PADDING:0:-1], column[-2 : -PADDING - 2 : -1]
    padded = np.concatenate([first - before, column, last - after])
    _pass_sections(padded, sections, start)
    _pass_sections(padded[::-1], sections, start)
    return padded[len(before) : len(before) + len(column)]


@lru_cache
def _sections(corner: float) -> tuple[Array, Array]:
    """Two second-order sections (2, 6) and their states (2, 2) at rest on a one."""
    sections = np.asarray(butter(4, corner, output='sos'))
    return sections, np.asarray(sosfilt_zi(sections))


@njit(cache=True, fastmath={'contract'})
def _pass_sections(column: Array, sections: Array, start: Array) -> None:
    """Filter a column (n,) in place, from its first value on."""
    b0, b1, b2, _, a1, a2 = sections[0]
    d0, d1, d2, _, c1, c2 = sections[1]
    s0, s1 = start[0, 0] * column[0], start[0, 1] * column[0]
    t0, t1 = start[1, 0] * column[0], start[1, 1] * column[0]
    for i in range(len(column)):
        u = column[i] + TINY
        v = b0 * u + s0
        s0 = (b1 * u + s1) - a1 * v
        s1 = b2 * u - a2 * v
        w = d0 * v + t0
        t0 = (d1 * v + t1) - c1 * w
        t1 = d2 * v - c2 * w
        column[i] = w


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
