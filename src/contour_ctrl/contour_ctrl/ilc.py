"""Iterative learning of a velocity signal: P-type with a zero-phase filter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.twin_file import ServoAxis

ComplexArray = NDArray[np.complex128]

FILTER_ORDER = 2


def zero_phase_lowpass(signal: Array, cutoff: float, period: float) -> Array:
    """Filter (n,) or (n, 2) forwards and backwards: Q of eq. 11, no phase shift.

    A Butterworth filter of second order, run twice: -6 dB at `cutoff` [Hz].

    Raises
    ------
    StageError
        A cutoff that is not between 0 and half the sampling rate.
    """
    # Only here: it takes half a second to import, which the start of a node need not pay.
    from scipy.signal import sosfiltfilt

    sections = _filter(cutoff, period)
    padding = min(len(signal) - 1, int(3.0 / (cutoff * period)))
    return np.asarray(sosfiltfilt(sections, signal, axis=0, padlen=padding))


def p_type_update(
    learned: Array,
    error: Array,
    gain: Array | float,
    cutoff: float,
    period: float,
    lead: int = 0,
) -> Array:
    """Return Q[u_j(k) + L e_j(k + lead)] (eq. 11; eqs. 26 and 30).

    Parameters
    ----------
    learned, error
        (n, 2) learned velocity of the last run [m/s] and its tracking error [m].
    gain
        L [1/s], one number or (2,).
    cutoff
        Of the zero-phase filter Q [Hz].
    lead
        Ticks by which the error is read ahead (see `design`); eqs. 26 and 30 have none.
    """
    ahead = error if lead == 0 else np.vstack([error[lead:], np.repeat(error[-1:], lead, axis=0)])
    return zero_phase_lowpass(learned + gain * ahead, cutoff, period)


def convergence_factor(
    impulse: Array, gain: float, cutoff: float, period: float, lead: int = 0
) -> float:
    """Return max over frequency of |Q (1 - L z^lead G)|: the error shrinks where it is < 1.

    `impulse` (n,) is the response [m] of the closed loop to a learned velocity of 1 m/s
    during one tick.
    """
    frequency, plant = _response(impulse, period)
    ahead = plant * np.exp(2j * np.pi * frequency * period * lead)
    return float(np.max(_response_of_q(frequency, cutoff, period) * np.abs(1.0 - gain * ahead)))


def design(impulse: Array, gain: float, period: float, factor: float = 0.5) -> tuple[int, float]:
    """Return the lead [ticks] and the cutoff [Hz] that this closed loop can learn with.

    The highest cutoff, in steps of 5 Hz, at which some lead makes every frequency's error
    shrink to `factor` or less in one iteration with L = `gain`, and the best lead there.
    `gain` = K_p takes a constant error away at once. P-type learning whose error is read
    ahead by the delay of the loop, with a zero-phase low pass: Longman, "Iterative learning
    control and repetitive control for engineering practice", Int. J. Control 73 (2000).

    Raises
    ------
    StageError
        No cutoff of 5 Hz or more is low enough.
    """
    frequency, plant = _response(impulse, period)
    leads = np.arange(int(np.ceil(2.0 / (gain * period))) + 1)
    shifts = np.exp(2j * np.pi * period * leads[:, None] * frequency)
    left = np.abs(1.0 - gain * plant * shifts)
    found: tuple[int, float] | None = None
    for cutoff in np.arange(5.0, 0.5 / period, 5.0):
        worst = np.max(left * _response_of_q(frequency, float(cutoff), period), axis=1)
        if worst.min() > factor:
            break
        found = int(leads[np.argmin(worst)]), float(cutoff)
    if found is None:
        raise StageError('no learning filter of 5 Hz or more converges: raise position_gain')
    return found


def closed_loop_impulse(axis: ServoAxis, position_gain: float, period: float, count: int) -> Array:
    """Position (count,) [m] of the nominal axis after a velocity command of 1 m/s for one tick.

    The loop of interfaces.md, "Servo controller", without quantisation and force limit:
    P position loop, PI velocity loop on the filtered difference quotient, mass and viscous
    friction under a zero-order hold.
    """
    decay = np.exp(-axis.viscous * period / axis.mass) if axis.viscous > 0.0 else 1.0
    coast = axis.mass / axis.viscous * (1.0 - decay) if axis.viscous > 0.0 else period
    if axis.viscous > 0.0:
        push_v = (1.0 - decay) / axis.viscous
        push_p = (period - coast) / axis.viscous
    else:
        push_v = period / axis.mass
        push_p = 0.5 * period**2 / axis.mass
    keep = np.exp(-period * axis.velocity_filter)
    position = velocity = filtered = last = integral = 0.0
    result = np.empty(count)
    for k in range(count):
        result[k] = position
        filtered = keep * filtered + (1.0 - keep) * (position - last) / period
        last = position
        error = (1.0 if k == 0 else 0.0) - position_gain * position - filtered
        force = axis.velocity_gain * error + integral
        integral += axis.integral_gain * error * period
        position += coast * velocity + push_p * force
        velocity = decay * velocity + push_v * force
    return result


def _response(impulse: Array, period: float) -> tuple[Array, ComplexArray]:
    """Frequencies (m,) [Hz] and the closed loop's response (m,) at them."""
    from scipy.fft import next_fast_len, rfft

    size = next_fast_len(4 * len(impulse))
    return np.asarray(np.fft.rfftfreq(size, period), dtype=float), np.asarray(rfft(impulse, size))


def _response_of_q(frequency: Array, cutoff: float, period: float) -> Array:
    """Q at frequencies (m,) [Hz]: the filter's power response, since it runs twice."""
    from scipy.signal import sosfreqz

    _, once = sosfreqz(_filter(cutoff, period), frequency, fs=1.0 / period)
    return np.asarray(np.abs(once) ** 2)


def _filter(cutoff: float, period: float) -> Array:
    from scipy.signal import butter

    if not 0.0 < cutoff < 0.5 / period:
        raise StageError(
            f'the learning filter of {cutoff:g} Hz must lie between 0 and '
            f'{0.5 / period:g} Hz: change ilc_cutoff'
        )
    return np.asarray(butter(FILTER_ORDER, cutoff, output='sos', fs=1.0 / period))
