"""How far a loop swings by itself, told from the error of one iteration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contour_ctrl.tick import Controller
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.quantities import AXES

#: Above the frequencies of a contour [Hz], within a band of this half width [Hz] about its peak.
ABOVE, BAND = 7.0, 2.0
#: Share of the error within the band, and its size as a share of the lag v / K_p. A loop that is
#: unstable has 0.11 and more of the lag, a stable one at most 0.08.
OSCILLATES = 0.5, 0.1
#: What a CMAC makes that is too fast for its loop: 0.8 to 1 within the band, 0.02 of the lag and
#: more. Other loops have at most 0.65 or 0.014 (the machines of `test_learning_recovers.py`).
RINGS = 0.7, 0.02
#: A swing of the loop's own: at least this share of the error within the band, and at most this
#: correlation with the iteration before there. Above what was learned, machines that ring just
#: below the cutoff have shares of 0.4 to 0.9 whose correlation is as often negative; swings that
#: the path makes have correlations of 0.6 and more (the same test).
NARROW, SAME = 0.4, 0.5


@dataclass(frozen=True)
class Ringing:
    """An axis' largest swing: frequency [Hz], size [m] and as a share of the lag, narrowness."""

    axis: str
    frequency: float
    size: float
    of_lag: float
    share: float

    def beyond(self, limits: tuple[float, float]) -> bool:
        """Whether it is narrower and larger than these limits."""
        return self.share > limits[0] and self.of_lag > limits[1]

    def refusal(self) -> StageError:
        """The error of a loop that no learning makes stable."""
        return StageError(
            f'the loop of {self.axis} oscillates at {self.frequency:.0f} Hz by '
            f'{1e6 * self.size:.0f} µm RMS before anything is learned: lower position_gain or '
            'cross_coupling'
        )


def ringing(error: Array, controller: Controller) -> list[Ringing]:
    """Swing of each axis in the tracking error (n, 2) [m] that the controller recorded."""
    reference = controller.reference
    found = []
    for axis, name in enumerate(AXES):
        peak, share, power = _peak(error[:, axis], reference.period)
        window = np.hanning(len(error))
        size = float(np.sqrt(2.0 * power / (len(error) * float(window @ window))))
        lag = reference.feed / controller.gains.position[axis]
        found.append(Ringing(name, peak, size, size / lag, share))
    return found


def own_swing(error: Array, before: Array, period: float) -> float:
    """Lowest frequency [Hz] at which the loop swings by itself; infinite where it does not.

    A narrow swing whose phase is another one than that of the iteration before, errors (n, 2) [m].
    """
    lowest = np.inf
    for axis in range(2):
        frequency, share, _ = _peak(error[:, axis], period)
        if share > NARROW and _repeats(error[:, axis], before[:, axis], frequency, period) < SAME:
            lowest = min(lowest, frequency)
    return lowest


def _peak(error: Array, period: float) -> tuple[float, float, float]:
    """Frequency [Hz] of the largest swing of (n,), its share of the power, and the power."""
    frequency, spectrum = _spectrum(error, period)
    power = np.where(frequency < ABOVE, 0.0, np.abs(spectrum) ** 2)
    peak, total = float(frequency[int(np.argmax(power))]), float(power.sum())
    near = float(power[np.abs(frequency - peak) <= BAND].sum())
    return peak, near / max(total, 1e-300), total


def _repeats(error: Array, before: Array, peak: float, period: float) -> float:
    """Correlation of two errors (n,) about a frequency [Hz]."""
    frequency, first = _spectrum(before, period)
    near = np.abs(frequency - peak) <= BAND
    first, second = first[near], _spectrum(error, period)[1][near]
    size = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(np.vdot(first, second).real) / size if size > 0.0 else 0.0


def _spectrum(error: Array, period: float) -> tuple[Array, NDArray[np.complex128]]:
    """Frequencies [Hz] and windowed spectrum of (n,)."""
    spectrum = np.fft.rfft(error * np.hanning(len(error)))
    return np.asarray(np.fft.rfftfreq(len(error), period)), np.asarray(spectrum)
