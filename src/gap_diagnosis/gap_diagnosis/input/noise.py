"""The noise of a record, measured: of the position, of the moment it is read, of the tracker.

A motion has next to nothing at the highest frequencies of its samples, noise has as much there as
anywhere. The sixth difference keeps the upper third of the band and makes a millionth of a motion
of 28 Hz sampled at 1 kHz: its mean square over the sum of its squared weights is the variance of
white noise. Noise that grows with the squared speed is that of the moment of reading: a sample
taken δ late is v δ off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from stage_core.arrays import Array

Mask = NDArray[np.bool_]

ORDER = 6  # of the difference
BLOCK, SHORT = 50, 10  # samples of a block, and of the moves in it that tell the speed
FAST = 2.0  # encoder steps a tick, from which on counting makes white noise
LEAST_BLOCKS = 20
#: Measured variance over that of an ideal encoder's steps, from which on it counts as noise: the
#: steps alone make up to 1.7 of it in blocks of one speed.
CLEARLY = 2.0
SURE = 5.0  # standard deviations of a jitter above zero
QUIET = 0.3  # share of a session's slowest points that tell a tracker's noise
WILD = 5.0  # times the expected power, from which on a block is a knock and no noise
TRACKER_BLOCK = 10  # points
FAINTEST = 1e-30  # m², below which a power is that of no noise
#: Measured noise of a tracker over the stated one, from which on it is taken.
CLEARLY_NOISIER = 1.15
GAUSS = 1.4826  # standard deviation over the median deviation, of normal numbers
#: Shares of a control period: least jitter about the stamps that is named, and one beyond which
#: ticks would change places. Clocks of good loops are within 0.02; those of a foreign simulator
#: without a fault have 0.001.
LEAST_JITTER, MOST_JITTER = 0.02, 0.5
#: Between the jitters that two axes of a machine show.
AGREE = 1.5


@dataclass(frozen=True)
class AxisNoise:
    """Noise of one axis: of its position [m], of the moment of reading [s], of its effort [N]."""

    position: float
    jitter: float
    effort: float
    quantum: float  # stated step [m]
    at_rest: float | None = None  # with which a loop that sticks is run [m]; None: as measured
    dry: bool = False  # whether the twin's friction holds the axis without presliding

    def std(self, velocity: Array | float) -> float:
        """Standard deviation [m] of a position over some velocities [m/s]."""
        return math.hypot(
            self.position, self.jitter * float(np.sqrt(np.mean(np.square(velocity))))
        )

    @property
    def beyond_steps(self) -> bool:
        """Whether there is more noise than counting in steps makes."""
        return self.jitter > 0.0 or self.step > 1.001 * self.quantum

    @property
    def step(self) -> float:
        """Step [m] of an ideal encoder with as much noise at rest."""
        return self.position * math.sqrt(12.0)


@dataclass(frozen=True)
class Sampling:
    """Jitter of the moments of reading about their stamps, as one axis shows it [s].

    `least` is the jitter that would make as much noise as the axis has otherwise: what is less
    does not show. `deviation` is the standard deviation of `std`; both are 0 where none shows.
    """

    std: float
    deviation: float
    least: float


@dataclass(frozen=True)
class Noise:
    """Noise of a session: of each axis, and of the tracker [m] (None without one).

    `sampling` is that of the moments of reading about their stamps as each axis shows it; None
    where it is too slow.
    """

    axes: tuple[AxisNoise, ...]
    tracker: float | None = None
    sampling: tuple[Sampling | None, ...] = ()


def axis_noise(
    position: Array, period: float, quantum: float, whole: Mask, effort: float = 0.0
) -> AxisNoise:
    """Noise of a position (n,) [m] on the ticks of a control period [s].

    Parameters
    ----------
    quantum : stated step of the encoder [m]; its own noise is the least there is
    whole : (n,) ticks that are far from lost ones
    """
    least = quantum / math.sqrt(12.0)
    power, square, moved = _blocks(position, period, whole)
    fast = moved > FAST * quantum / period
    chosen = fast if np.count_nonzero(fast) >= LEAST_BLOCKS else np.ones(len(power), dtype=bool)
    if np.count_nonzero(chosen) < LEAST_BLOCKS:
        return AxisNoise(least, 0.0, effort, quantum)
    white, jitter, deviation = speed_fit(power[chosen], square[chosen])
    # Steps that are coarser than stated make more noise in motion than at rest, as jitter does.
    counted = float(np.median(moved[chosen])) <= FAST * encoder_step(position) / period
    unsure = jitter <= SURE * deviation or jitter * float(np.mean(square[chosen])) < least**2
    if counted or unsure:
        white, jitter = float(np.median(power[chosen])), 0.0
    if white < CLEARLY * least**2:
        white = least**2
    return AxisNoise(math.sqrt(white), math.sqrt(jitter), effort, quantum)


def sampling_jitter(
    position: Array, offset: Array, period: float, quantum: float, whole: Mask
) -> Sampling | None:
    """Jitter of the moments of reading about their stamps; None where the axis is too slow.

    It shows where it makes more noise than all else does at the speeds of the axis: on 68 axes
    without one at most 0.04 of the power was taken for it, of one of 3 µs there was 2000 times.

    Parameters
    ----------
    position, period, quantum, whole : as for :func:`axis_noise`
    offset : (n,) of the stamps from the ticks [s]
    """
    on_tick = position - np.gradient(position, period) * offset
    power, square, moved = _blocks(on_tick, period, whole)
    fast = moved > FAST * quantum / period
    if np.count_nonzero(fast) < LEAST_BLOCKS:
        return None
    white, jitter, deviation = speed_fit(power[fast], square[fast])
    least = max(white, quantum**2 / 12.0) / float(np.mean(square[fast]))
    if jitter <= max(SURE * deviation, least):
        return Sampling(0.0, 0.0, math.sqrt(least))
    return Sampling(math.sqrt(jitter), 0.5 * deviation / math.sqrt(jitter), math.sqrt(least))


def jitter_finding(
    noises: Sequence[Noise], period: float, doubted: Sequence[bool]
) -> tuple[float, float] | None:
    """Jitter [s] of the samples about their stamps, and its standard deviation; None without.

    All axes that would show it must show the same, those left out whose encoder errs (`doubted`).
    """
    asked = [
        own
        for noise in noises
        for own, doubt in zip(noise.sampling, doubted, strict=True)
        if own is not None and not doubt
    ]
    largest = max((own.std for own in asked), default=0.0)
    told = [own for own in asked if AGREE * own.least < largest]
    values = np.array([own.std for own in told])
    if not told or values.min() < LEAST_JITTER * period:
        return None
    if values.max() > min(AGREE * values.min(), MOST_JITTER * period):
        return None
    return float(values.mean()), math.hypot(
        max(own.deviation for own in told), 0.5 * float(np.ptp(values))
    )


def _blocks(position: Array, period: float, whole: Mask) -> tuple[Array, Array, Array]:
    """Of each block: variance of white noise [m²], mean square and root of it of the speed."""
    power, inner, use = _power(position, whole)
    # Over some ticks: noise of a difference falls with the length of it.
    moves = np.diff(position[inner].reshape(len(power), -1, SHORT)[:, :, [0, -1]], axis=2)[:, :, 0]
    square = np.mean((moves / ((SHORT - 1) * period)) ** 2, axis=1)
    return power[use], square[use], np.sqrt(square[use])


def _power(signal: Array, whole: Mask) -> tuple[Array, slice, Mask]:
    """Mean square of what is rough in each block of a signal, their samples, which are whole."""
    rapid = rough(signal)
    count = len(rapid) // BLOCK
    inner = slice(ORDER // 2, ORDER // 2 + count * BLOCK)
    power = np.mean(rapid[: count * BLOCK].reshape(count, BLOCK) ** 2, axis=1)
    return power, inner, np.asarray(whole[inner].reshape(count, BLOCK).all(axis=1))


def rough(signal: Array) -> Array:
    """Sixth difference (n - 6, …) of a signal (n, …), scaled to keep the variance of noise."""
    return np.asarray(np.diff(signal, ORDER, axis=0) / math.sqrt(math.comb(2 * ORDER, ORDER)))


def white_part(signal: Array, whole: Mask) -> float:
    """Standard deviation of what is white in a signal (n,), in most of its blocks."""
    power, _, use = _power(signal, whole)
    return math.sqrt(float(np.median(power[use]))) if use.any() else 0.0


def tracker_noise(difference: Array, speed: Array, encoder: float) -> float:
    """Noise [m] of tracker points from tracker minus encoder (m, a) [m], where both go slowly.

    Parameters
    ----------
    speed : (m,) of the machine at the points [m/s]
    encoder : noise of the encoders, root mean square over the axes [m]; it is taken out
    """
    rapid = rough(difference)
    count = len(rapid) // TRACKER_BLOCK
    if count < LEAST_BLOCKS:
        return 0.0
    power = np.mean(rapid[: count * TRACKER_BLOCK].reshape(count, -1) ** 2, axis=1)
    at = speed[ORDER // 2 : ORDER // 2 + count * TRACKER_BLOCK].reshape(count, -1).max(axis=1)
    slow = power[at <= np.quantile(at, QUIET)]
    calm = slow[slow <= WILD * float(np.median(slow))]
    return math.sqrt(max(float(np.mean(calm)) - encoder**2, 0.0))


def speed_fit(power: Array, square: Array) -> tuple[float, float, float]:
    """Power = white + jitter · speed², each block weighed by its own expected scatter.

    White noise [m²], squared jitter [s²] and the standard deviation of the latter.
    """
    matrix = np.column_stack([np.ones_like(square), square])
    expected = np.full_like(power, float(np.median(power)) + FAINTEST)
    solution = np.zeros(2)
    for _ in range(6):
        kept = power < WILD * expected
        solution, _ = nnls(matrix[kept] / expected[kept, None], power[kept] / expected[kept])
        expected = np.maximum(matrix @ solution, 1e-3 * float(np.median(power)) + FAINTEST)
    scaled = matrix / expected[:, None]
    scatter = np.var(power / expected)
    covariance = np.linalg.pinv(scaled.T @ scaled) * scatter
    deviation = math.sqrt(max(float(covariance[1, 1]), 0.0))
    return float(solution[0]), float(solution[1]), deviation


def encoder_step(position: Array) -> float:
    """Least common step of an encoder's reading (n,) [m]; 0 where there is none.

    It is that of the changes of its changes: these are few steps at any speed.
    """
    changes = np.abs(np.diff(position, 2))
    changes = changes[changes > 1e-11]
    if len(changes) < 100:
        return 0.0
    step = float(np.percentile(changes, 1.0))
    multiples = changes / step
    on_grid = np.abs(multiples - np.rint(multiples)) < 0.02 * np.maximum(1.0, multiples**0.5)
    return step if float(np.mean(on_grid)) > 0.97 else 0.0
