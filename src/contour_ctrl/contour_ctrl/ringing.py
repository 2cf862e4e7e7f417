"""How far a loop swings by itself, told from the error of one iteration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contour_ctrl.tick import Controller
from stage_core.errors import StageError
from stage_core.quantities import AXES

FloatArray = NDArray[np.float64]

#: Above the frequencies of a contour [Hz], within a band of this half width [Hz] about its peak.
ABOVE, BAND = 7.0, 2.0
#: Share of the error within the band, and its size as a share of the lag v / K_p. A loop that is
#: unstable has 0.11 and more of the lag, a stable one at most 0.08.
OSCILLATES = 0.5, 0.1
#: What a CMAC makes that is too fast for its loop: 0.8 to 1 within the band, 0.02 of the lag and
#: more. Other loops have at most 0.65 or 0.014 (the machines of `test_learning_recovers.py`).
RINGS = 0.7, 0.02


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


def ringing(error: FloatArray, controller: Controller) -> list[Ringing]:
    """Swing of each axis in the tracking error (n, 2) [m] that the controller recorded."""
    reference = controller.reference
    frequency = np.fft.rfftfreq(len(error), reference.period)
    window = np.hanning(len(error))
    found = []
    for axis, name in enumerate(AXES):
        power = np.abs(np.fft.rfft(error[:, axis] * window)) ** 2
        power[frequency < ABOVE] = 0.0
        total = float(power.sum())
        peak = float(frequency[int(np.argmax(power))])
        near = float(power[np.abs(frequency - peak) <= BAND].sum())
        size = float(np.sqrt(2.0 * total / (len(error) * float(window @ window))))
        lag = reference.feed / controller.gains.position[axis]
        found.append(Ringing(name, peak, size, size / lag, near / max(total, 1e-300)))
    return found
