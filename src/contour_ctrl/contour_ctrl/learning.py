"""What happens between two iterations of a contour: learn, keep the best, refuse to diverge."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from contour_ctrl import ilc
from contour_ctrl.reinforcement import LearningRate
from stage_core.errors import StageError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class LearningSettings:
    """Settings of the iterative learning; the defaults are `ilc.design` for K_p = 40 1/s at 1 kHz.

    Attributes
    ----------
    gain
        L_initial [1/s] per axis.
    cutoff
        Of the zero-phase filter [Hz].
    lead
        Ticks by which the error is read ahead; the paper's eqs. 26 and 30 have 0.
    reinforced
        Whether the fuzzy regulator changes the rate; otherwise it is fixed.
    reading
        Reading of the regulator's equations.
    divergence
        An iteration whose RMS error exceeds this multiple of the best one is not learned
        from: the best signal returns, at the smallest rate. 0 switches the protection off.
    """

    gain: tuple[float, float] = (40.0, 40.0)
    cutoff: float = 25.0
    lead: int = 15
    reinforced: bool = True
    reading: str = 'recommended'
    floor: float = 0.1
    divergence: float = 3.0

    def __post_init__(self) -> None:
        if min(self.gain) < 0.0 or not np.all(np.isfinite(self.gain)):
            raise StageError(f'ilc_gain must not be negative: {self.gain}')
        if self.lead < 0:
            raise StageError('ilc_lead must not be negative')


@dataclass
class Learner:
    """The learned velocity of both axes, the best so far, and the regulators."""

    count: int
    period: float
    settings: LearningSettings = field(default_factory=LearningSettings)

    def __post_init__(self) -> None:
        self.learned = np.zeros((self.count, 2))
        self.best = np.zeros((self.count, 2))
        self.best_rms = [float('inf'), float('inf')]
        self.factors: list[tuple[float, float]] = []
        self.restored: list[tuple[bool, bool]] = []
        self.regulators = [
            LearningRate(self.settings.reading, self.settings.floor) for _ in range(2)
        ]

    def learn(self, error: FloatArray) -> FloatArray:
        """Take the tracking error (n, 2) [m] of an iteration; return the next signal (n, 2).

        Raises
        ------
        StageError
            An error that is not finite: the iteration was not complete.
        """
        if error.shape != self.learned.shape or not np.all(np.isfinite(error)):
            raise StageError('the iteration left ticks without a measurement: nothing is learned')
        rms = np.sqrt(np.mean(error**2, axis=0))
        factors, restored = [], []
        for axis in range(2):
            factor = 1.0
            if self.settings.reinforced:
                factor = self.regulators[axis].after(float(rms[axis]))
            diverged = 0.0 < self.settings.divergence * self.best_rms[axis] < rms[axis]
            if rms[axis] < self.best_rms[axis]:
                self.best_rms[axis] = float(rms[axis])
                self.best[:, axis] = self.learned[:, axis]
            if diverged:
                # The best signal as it was: its own error is not at hand any more.
                self.learned[:, axis] = self.best[:, axis]
                factor = 0.0
            else:
                self.learned[:, axis] = ilc.p_type_update(
                    self.learned[:, axis : axis + 1],
                    error[:, axis : axis + 1],
                    factor * self.settings.gain[axis],
                    self.settings.cutoff,
                    self.period,
                    self.settings.lead,
                )[:, 0]
            factors.append(factor)
            restored.append(diverged)
        self.factors.append((factors[0], factors[1]))
        self.restored.append((restored[0], restored[1]))
        return self.learned
