"""What happens between two iterations of a contour: learn, keep the best, do not diverge."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from contour_ctrl import ilc
from contour_ctrl.reinforcement import LearningRate
from contour_ctrl.tick import EX, Controller
from stage_core.errors import StageError
from stage_core.quantities import AXES

FloatArray = NDArray[np.float64]

#: Correlation of a growing error with the change of the signal beyond which the learning made it:
#: 0.7 to 0.9 under a wrong model, 0.1 to 0.3 after a push (`benchmarks/paper3_tables.py --peers`).
OWN_SHARE = 0.5
#: The longest lead that is looked for, in 1 / L: two is the range of `ilc.design`, a delay of 5 ms
#: and three times the mass ask for three.
LONGEST_LEAD = 3.0
#: Share of the rate in the first update, when nobody has seen yet whether the model is right. With
#: twice the mass the second lap then has 4.5 instead of 8.0 um (the first 6.8), with the nominal
#: mass 2.6 um with either (`benchmarks/paper3_tables.py --peers`).
FIRST_STEP = 0.5
#: A loop oscillates where this share of an axis' error, above the frequencies of a contour [Hz],
#: lies within a band of this half width [Hz], and is more than this share of the lag v / K_p.
OSCILLATION_SHARE, OSCILLATION_ABOVE, OSCILLATION_BAND, OSCILLATION_OF_LAG = 0.5, 7.0, 2.0, 0.1


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
        An iteration whose RMS error exceeds this multiple of the best one has grown (see
        `Learner`). 0 switches the protection off. With four times the random force of the
        benchmark the RMS of 30 settled iterations scatters by a factor of 1.2.
    """

    gain: tuple[float, float] = (40.0, 40.0)
    cutoff: float = 25.0
    lead: int = 15
    reinforced: bool = True
    reading: str = 'recommended'
    floor: float = 0.2
    divergence: float = 1.2

    def __post_init__(self) -> None:
        if min(self.gain) < 0.0 or not np.all(np.isfinite(self.gain)):
            raise StageError(f'ilc_gain must not be negative: {self.gain}')
        if self.lead < 0:
            raise StageError('ilc_lead must not be negative')


@dataclass
class Lap:
    """An iteration: its RMS error (2,) [m], error (n, 2) [m], signal (n, 2) [m/s] and CMAC."""

    rms: FloatArray
    error: FloatArray
    signal: FloatArray
    weights: FloatArray


@dataclass
class Learner:
    """The learned velocity of both axes, the best iteration so far, and the regulators.

    Where the error grows beyond the best iteration, the change of the signal since then tells
    why. An error that follows it was made by the learning: the best signal returns, the rate
    halves, the lead becomes the delay at which the error follows the signal, and the CMAC, whose
    delay nobody designs, stays as it was then. Another error is a disturbance: the same signal is
    tried once more. A machine on which the best signal is worse than before is another one.
    """

    count: int
    period: float
    settings: LearningSettings = field(default_factory=LearningSettings)

    def __post_init__(self) -> None:
        self.learned = np.zeros((self.count, 2))
        self.best: Lap | None = None
        self.rate = 1.0
        self.lead = [self.settings.lead] * 2
        self.factors: list[tuple[float, float]] = []
        self.returns: list[bool] = []
        self._repeated = self._distrusted = False
        self._regulate()

    def _regulate(self) -> None:
        reading, floor = self.settings.reading, self.settings.floor
        self.regulators = [LearningRate(reading, floor) for _ in range(2)]

    def after(self, controller: Controller) -> None:
        """Learn from the iteration that `controller` recorded; change its signal and CMAC.

        Raises
        ------
        StageError
            An error that is not finite, or a loop that oscillates before anything is learned.
        """
        error = controller.record[:, EX : EX + 2].copy()
        if self.best is None and self.settings.divergence > 0.0:
            _refuse_oscillation(error, controller)
        controller.learned[:] = self.learn(error, controller.weights)
        if self.rate < 1.0:
            controller.freeze_cmac()

    def learn(self, error: FloatArray, weights: FloatArray) -> FloatArray:
        """Take the tracking error (n, 2) [m] of an iteration; return the next signal (n, 2).

        `weights` of the CMAC are put back where the best iteration returns.
        """
        if error.shape != self.learned.shape or not np.all(np.isfinite(error)):
            raise StageError('the iteration left ticks without a measurement: nothing is learned')
        lap = Lap(np.sqrt(np.mean(error**2, axis=0)), error, self.learned.copy(), weights.copy())
        best = lap if self.best is None or lap.rms.sum() <= self.best.rms.sum() else self.best
        self.best = best
        grown = self.settings.divergence > 0.0 and bool(
            np.any(lap.rms > self.settings.divergence * best.rms)
        )
        self.returns.append(False)
        if grown:
            leads, own = self._cause(lap, best)
            if not own and not self._repeated:
                self._repeated = True
                self.factors.append((0.0, 0.0))
                return self.learned
            if not own and self._distrusted:
                self.best = best = lap
            elif own:
                self.lead = leads
            lap = best
            self._return_to(best, weights)
        self._distrusted, self._repeated = grown, False
        self._update(lap)
        return self.learned

    def _cause(self, lap: Lap, best: Lap) -> tuple[list[int], bool]:
        """Ticks by which each axis' error follows the signal, and whether it does so at all."""
        found = [
            _following(
                lap.signal[:, axis] - best.signal[:, axis],
                best.error[:, axis] - lap.error[:, axis],
                int(LONGEST_LEAD / (max(self.settings.gain[axis], 1e-9) * self.period)),
            )
            for axis in range(2)
        ]
        worst = int(np.argmax(lap.rms / np.maximum(best.rms, 1e-12)))
        return [lead for lead, _ in found], found[worst][1] >= OWN_SHARE

    def _return_to(self, best: Lap, weights: FloatArray) -> None:
        self.returns[-1] = True
        self.rate *= 0.5
        self.learned = best.signal.copy()
        weights[:] = best.weights
        self._regulate()

    def _update(self, lap: Lap) -> None:
        """Scheme 2 or 3 (eqs. 26, 30) from an iteration's error."""
        settings, factors = self.settings, [1.0, 1.0]
        cautious = settings.divergence > 0.0 and not self.factors
        rate = self.rate * (FIRST_STEP if cautious else 1.0)
        for axis in range(2):
            if settings.reinforced:
                factors[axis] = self.regulators[axis].after(float(lap.rms[axis]))
            self.learned[:, axis : axis + 1] = ilc.p_type_update(
                self.learned[:, axis : axis + 1],
                lap.error[:, axis : axis + 1],
                factors[axis] * rate * settings.gain[axis],
                settings.cutoff,
                self.period,
                self.lead[axis],
            )
        self.factors.append((factors[0], factors[1]))


def _following(cause: FloatArray, effect: FloatArray, longest: int) -> tuple[int, float]:
    """Delay [ticks] up to `longest` at which (n,) follows (n,) most, and the correlation there."""
    longest = min(longest, len(cause) - 1)
    products = [float(cause[: len(cause) - k] @ effect[k:]) for k in range(longest + 1)]
    delay = int(np.argmax(products))
    size = float(np.linalg.norm(cause) * np.linalg.norm(effect))
    return delay, products[delay] / size if size > 0.0 else 0.0


def _refuse_oscillation(error: FloatArray, controller: Controller) -> None:
    """Raise where the loop swings before anything is learned: no learning makes it stable."""
    reference = controller.reference
    frequency = np.fft.rfftfreq(len(error), reference.period)
    window = np.hanning(len(error))
    for axis, name in enumerate(AXES):
        power = np.abs(np.fft.rfft(error[:, axis] * window)) ** 2
        power[frequency < OSCILLATION_ABOVE] = 0.0
        peak = frequency[int(np.argmax(power))]
        near = np.abs(frequency - peak) <= OSCILLATION_BAND
        swing = np.sqrt(2.0 * power.sum() / (len(error) * float(window @ window)))
        lag = reference.feed / controller.gains.position[axis]
        if (
            swing > OSCILLATION_OF_LAG * lag
            and power[near].sum() > OSCILLATION_SHARE * power.sum()
        ):
            raise StageError(
                f'the loop of {name} oscillates at {peak:.0f} Hz by {1e6 * swing:.0f} µm RMS '
                'before anything is learned: lower position_gain, cross_coupling or cmac_rate'
            )
