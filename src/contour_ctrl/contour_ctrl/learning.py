"""What happens between two iterations of a contour: learn, keep the best, do not diverge."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from contour_ctrl import ilc
from contour_ctrl.reinforcement import LearningRate
from contour_ctrl.ringing import OSCILLATES, RINGS, own_swing, ringing
from contour_ctrl.tick import EX, Controller
from stage_core.arrays import Array
from stage_core.errors import StageError

#: Correlation of a growing error with the change of the signal beyond which the learning made it:
#: 0.7 to 0.9 under a wrong model, 0.1 to 0.3 after a push (`benchmarks/paper3_tables.py --peers`).
OWN_SHARE = 0.5
#: The longest lead that is looked for, in 1 / L: two is the range of `ilc.design`, a delay of 5 ms
#: and three times the mass ask for three.
LONGEST_LEAD = 3.0
#: Share of the cutoff up to which the first error is learned, when nobody has seen yet whether the
#: model is right. With a quarter some machines of twice to three times the mass have a lap that is
#: worse than the first, with an eighth none (`tests/contour_ctrl/test_learning_recovers.py`).
FIRST_BAND = 0.125
#: The first error is learned up to this frequency [Hz] where it is above that share of the cutoff:
#: the loop of 25 Hz in that test has it as an eighth. A Zaber chain, whose cutoff is 5.5 Hz, would
#: spend its first three laps below 3 Hz (`benchmarks/zaber_feed.py`: 0.23 in place of 0.08 µm).
FIRST_FREQUENCY = 3.0
#: How the band widens after a lap that did not grow, up to half the cutoff and from there on. With
#: octaves alone 2 of 48 machines whose loop rings just below the cutoff have a lap that is worse
#: than the first, by 1.06 and 1.16; with these steps none (`RINGING` in the same test has them).
WIDER, LAST_WIDER = 2.0, 1.5
#: How a lap that grew narrows the band, and how far it may widen again. Without the second, half
#: the gain, three times the mass and 5 ms more delay grow in every third lap (the same test).
NARROWER, WIDEST = 0.5, 0.7


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
    """An iteration: its RMS error (2,) [m], error (n, 2) [m] and signal (n, 2) [m/s].

    `weights` are the CMAC's at its end, `began` those at its beginning.
    """

    rms: Array
    error: Array
    signal: Array
    weights: Array
    began: Array


@dataclass
class Learner:
    """The learned velocity of both axes, the best iteration so far, and the regulators.

    The first error is learned up to `FIRST_BAND` of the cutoff, or `FIRST_FREQUENCY`; the band
    widens with each iteration that does not grow, and stays below a swing that is the loop's own:
    one that no iteration repeats. The CMAC, whose delay nobody designs, learns in
    the first one, and not at all where the loop rings with it.

    Where the error grows beyond the best iteration, the change of the signal since then tells
    why. An error that follows it was made by the learning: the best signal returns, rate and band
    become smaller, and the lead becomes the delay at which the error follows the signal. Another
    error is a disturbance: the same signal is tried once more. A machine on which the best signal
    is worse than before is another one.
    """

    count: int
    period: float
    settings: LearningSettings = field(default_factory=LearningSettings)

    def __post_init__(self) -> None:
        self.learned = np.zeros((self.count, 2))
        self.best: Lap | None = None
        self.rate = self.widest = 1.0
        #: Share of the cutoff up to which an error is learned.
        self.band = 1.0
        if self.guarded:
            self.band = min(1.0, max(FIRST_BAND, FIRST_FREQUENCY / self.settings.cutoff))
        self.lead = [self.settings.lead] * 2
        self.factors: list[tuple[float, float]] = []
        self.returns: list[bool] = []
        #: Weights of the CMAC as the iteration at hand began; None: empty.
        self.began: Array | None = None
        self._last: Array | None = None
        self._repeated = self._distrusted = False
        self._regulate()

    @property
    def guarded(self) -> bool:
        """Whether the learning watches itself."""
        return self.settings.divergence > 0.0

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
        if self.guarded and self.best is None and self._oscillates(error, controller):
            return
        controller.learned[:] = self.learn(error, controller.weights)
        if self.guarded:
            controller.freeze_cmac()

    def learn(self, error: Array, weights: Array) -> Array:
        """Take the tracking error (n, 2) [m] of an iteration; return the next signal (n, 2).

        `weights` of the CMAC are put back where the best iteration returns.
        """
        if error.shape != self.learned.shape or not np.all(np.isfinite(error)):
            raise StageError('the iteration left ticks without a measurement: nothing is learned')
        lap = self._lap(error, weights)
        best = lap if self.best is None or lap.rms.sum() <= self.best.rms.sum() else self.best
        self.best = best
        grown = self.guarded and bool(np.any(lap.rms > self.settings.divergence * best.rms))
        self.returns.append(False)
        if grown:
            own = self._cause(lap, best)
            if not own and not self._repeated:
                self._repeated = True
                self.factors.append((0.0, 0.0))
                return self.learned
            if not own and self._distrusted:
                self.best = best = lap
            lap = best
            self._return_to(best, weights)
        elif len(self.returns) > 1:
            self._widen(error)
        self._last = error
        self._distrusted, self._repeated = grown, False
        self._update(lap)
        return self.learned

    def _widen(self, error: Array) -> None:
        """Learn up to a higher frequency, but stay below a swing that is the loop's own.

        The CMAC changes until the second iteration, and the signal in one that grew.
        """
        if self._last is not None and len(self.returns) > 2 and not self._distrusted:
            swing = own_swing(error, self._last, self.period) / self.settings.cutoff
            if swing > self.band / NARROWER:
                self.widest = min(self.widest, NARROWER * swing)
        self.band = min(self.widest, self.band * (WIDER if self.band < 0.5 else LAST_WIDER))

    def _oscillates(self, error: Array, controller: Controller) -> bool:
        """Whether the first iteration is no measure of the loop; a CMAC that rings is forgotten.

        Raises
        ------
        StageError
            The loop oscillates without a CMAC: no learning makes it stable.
        """
        found = ringing(error, controller)
        unstable = [ring for ring in found if ring.beyond(OSCILLATES)]
        if controller.adapts and (unstable or any(ring.beyond(RINGS) for ring in found)):
            controller.weights[:] = 0.0
            controller.freeze_cmac()
        elif unstable:
            raise unstable[0].refusal()
        return bool(unstable)

    def _lap(self, error: Array, weights: Array) -> Lap:
        began = np.zeros_like(weights) if self.began is None else self.began
        self.began = weights.copy()
        rms = np.sqrt(np.mean(error**2, axis=0))
        return Lap(rms, error, self.learned.copy(), weights.copy(), began)

    def _cause(self, lap: Lap, best: Lap) -> bool:
        """Whether the error follows the signal, or the CMAC's memory; each axis' lead if so."""
        found = [
            _following(
                lap.signal[:, axis] - best.signal[:, axis],
                best.error[:, axis] - lap.error[:, axis],
                int(LONGEST_LEAD / (max(self.settings.gain[axis], 1e-9) * self.period)),
            )
            for axis in range(2)
        ]
        worst = int(np.argmax(lap.rms / np.maximum(best.rms, 1e-12)))
        if found[worst][1] >= OWN_SHARE:
            for axis, (lead, share) in enumerate(found):
                self.lead[axis] = lead if share >= OWN_SHARE else self.lead[axis]
            return True
        return bool(np.any(lap.began != best.began))

    def _return_to(self, best: Lap, weights: Array) -> None:
        self.returns[-1] = True
        self.rate *= 0.5
        self.widest = min(self.widest, WIDEST * self.band)
        self.band *= NARROWER
        self.learned = best.signal.copy()
        weights[:] = best.began
        self.began = best.began
        self._regulate()

    def _update(self, lap: Lap) -> None:
        """Scheme 2 or 3 (eqs. 26, 30) from an iteration's error."""
        settings, factors, error = self.settings, [1.0, 1.0], lap.error
        if self.band < 1.0:
            error = ilc.zero_phase_lowpass(error, self.band * settings.cutoff, self.period)
        for axis in range(2):
            if settings.reinforced:
                factors[axis] = self.regulators[axis].after(float(lap.rms[axis]))
            self.learned[:, axis : axis + 1] = ilc.p_type_update(
                self.learned[:, axis : axis + 1],
                error[:, axis : axis + 1],
                factors[axis] * self.rate * settings.gain[axis],
                settings.cutoff,
                self.period,
                self.lead[axis],
            )
        self.factors.append((factors[0], factors[1]))


def _following(cause: Array, effect: Array, longest: int) -> tuple[int, float]:
    """Delay [ticks] up to `longest` at which (n,) follows (n,) most, and the correlation there."""
    longest = min(longest, len(cause) - 1)
    products = [float(cause[: len(cause) - k] @ effect[k:]) for k in range(longest + 1)]
    delay = int(np.argmax(products))
    size = float(np.linalg.norm(cause) * np.linalg.norm(effect))
    return delay, products[delay] / size if size > 0.0 else 0.0
