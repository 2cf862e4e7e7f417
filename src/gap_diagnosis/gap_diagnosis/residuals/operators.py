"""Signals of mechanisms, from recorded motion: play, pre-sliding, filters, carried masses."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.signal import butter, lfilter, sosfiltfilt

Array = NDArray[np.float64]


@njit(cache=True)
def play(position: Array, width: float) -> Array:
    """Output of the play operator minus its input, shape (n,) [m]; centred at the start.

    Nordin and Gutman, "Controlling mechanical systems with backlash", Automatica 38 (2002).
    """
    out = np.empty(len(position))
    half = 0.5 * width
    follower = position[0]
    for k in range(len(position)):
        if position[k] - follower > half:
            follower = position[k] - half
        elif follower - position[k] > half:
            follower = position[k] + half
        out[k] = follower - position[k]
    return out


@njit(cache=True)
def presliding_state(position: Array, presliding: float) -> Array:
    """Friction as a share of its sliding value, -1 … 1, from the path of a position (n,) [m].

    dz/dp = (1 - z sign(dp)) / presliding, integrated exactly over each step (Dahl 1968).
    """
    out = np.zeros(len(position))
    z = 0.0
    for k in range(1, len(position)):
        step = position[k] - position[k - 1]
        if step != 0.0:
            towards = 1.0 if step > 0.0 else -1.0
            if presliding > 0.0:
                z = towards + (z - towards) * math.exp(-abs(step) / presliding)
            else:
                z = towards
        out[k] = z
    return out


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


def carried_mass(acceleration: Array, period: float, frequency: float, damping: float) -> Array:
    """Acceleration of a mass on a spring and damper minus that of its motor, shape (n,).

    -s² / (s² + 2ζω s + ω²) of the motor's acceleration, bilinear with the frequency warped.
    """
    omega = 2.0 * math.pi * frequency
    k = omega / math.tan(min(0.5 * omega * period, 1.5))
    a0 = k * k + 2.0 * damping * omega * k + omega**2
    a = [1.0, 2.0 * (omega**2 - k * k) / a0, (k * k - 2.0 * damping * omega * k + omega**2) / a0]
    b = [-k * k / a0, 2.0 * k * k / a0, -k * k / a0]
    return np.asarray(lfilter(b, a, acceleration))


def band_limited(signal: Array, period: float, corner: float = 90.0) -> Array:
    """Zero-phase Butterworth low-pass (n,), flat to about 0.8 of the corner [Hz].

    Keeps the encoder's noise out of a regressor that the target shares it with.
    """
    sections = butter(4, min(2.0 * corner * period, 0.9), output='sos')
    return np.asarray(sosfiltfilt(sections, signal))
