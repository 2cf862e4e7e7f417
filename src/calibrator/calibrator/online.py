"""Adapting a model while the stage runs: recursive least squares with forgetting, guarded."""

from __future__ import annotations

import copy
from collections import deque

import numpy as np

from calibrator.gain import held_out_gain
from calibrator.models.adaptable import Adaptable
from calibrator.models.base import CalibrationModel
from calibrator.places import distinct_places
from calibrator.prepare import FEWEST_PLACES
from stage_core.arrays import Array
from stage_core.errors import StageError

JUDGED_EVERY = 5
"""Each fifth sample is held out: judged with the prediction made before, never learned."""
WINDOW = 8
"""Held-out samples that decide about keeping or rolling back."""
WORSE = 1.1
"""The adapted model is rolled back when its held-out error exceeds the kept one's by this."""
FAR_WORSE = 5.0
"""So much worse, two held-out samples are enough to roll back: a tracker that lost its target."""
GATE = 5.0
"""A sample further off than this many times what the held-out ones are is not learned."""
PROOF = 16
"""Samples, each predicted before it is learned, whose gain says whether the model is in use."""
WINDUP = 1e4
"""Growth of the covariance over its start at which forgetting pauses: nothing new was seen."""


class RecursiveLeastSquares:
    """Weights of a linear model, updated sample by sample.

    Parameters
    ----------
    weights
        Start, (p,).
    deviation
        How far a weight may be expected to have moved, in units of the target divided by the
        typical size of its regressor `size` (p,); sets the first gains.
    noise
        Standard deviation of a sample's target.
    forgetting
        In (0, 1]: weight of a sample relative to the next one. 0.99 remembers about 100.
    """

    def __init__(
        self, weights: Array, size: Array, deviation: float, noise: float, forgetting: float
    ) -> None:
        if not 0.0 < forgetting <= 1.0:
            raise StageError(f'the forgetting factor must lie in (0, 1], got {forgetting}')
        self.weights = np.array(weights, dtype=float)
        self.forgetting = forgetting
        scale = np.where(size > 0.0, size, 1.0)
        self.covariance = np.diag((deviation / noise / scale) ** 2)
        self._limit = WINDUP * float(np.sum(np.diagonal(self.covariance) * scale**2))
        self._scale = scale

    def update(self, regressor: Array, target: float) -> float:
        """Learn one sample; the error of the prediction before it."""
        projected = self.covariance @ regressor
        gain = projected / (self.forgetting + float(regressor @ projected))
        error = target - float(regressor @ self.weights)
        self.weights = self.weights + gain * error
        self.covariance = self.covariance - np.outer(gain, projected)
        if float(np.sum(np.diagonal(self.covariance) * self._scale**2)) < self._limit:
            self.covariance /= self.forgetting
        # Rounding must not make the covariance asymmetric, or it turns indefinite.
        self.covariance = 0.5 * (self.covariance + self.covariance.T)
        return error


class OnlineAdapter:
    """Adapts the linear weights of a fitted model and rolls back what does not help.

    A sample that is off by more than `GATE` times the largest of `deviation`, `noise` and the RMS
    of the last held-out errors is refused: a reflector that was knocked, a beam that came back
    elsewhere. Where the stage itself jumped, the held-out samples are off too and open the gate.

    What is learned is in use from when its gain over the trained model, at the last `PROOF`
    samples before each was learned, has an interval above zero: the rule of a new training.

    Parameters
    ----------
    model
        A fitted model with linear weights; it is copied. `structured`: all coefficients;
        `it2fls`: the consequents; `affine`: offset and gains.
    deviation
        Drift that is to be followed [m].
    noise
        Standard deviation of a measured point [m].
    forgetting
        Of the recursive least squares.

    Raises
    ------
    StageError
        If the method has no linear weights.
    """

    def __init__(
        self, model: CalibrationModel, deviation: float, noise: float, forgetting: float
    ) -> None:
        if not isinstance(model, Adaptable):
            raise StageError(
                f'method {model.method} has no linear weights to adapt: use structured, it2fls or '
                'affine'
            )
        self.trained = model
        self.model: Adaptable = copy.deepcopy(model)
        self.kept = copy.deepcopy(model)
        self.proven = False
        self.rollbacks = 0
        self.learned = 0
        self.refused = 0
        self._settings = (deviation, noise, forgetting)
        self._estimators: list[RecursiveLeastSquares] = []
        self._count = 0
        self._judged: deque[tuple[float, float]] = deque(maxlen=WINDOW)
        self._errors: deque[float] = deque(maxlen=WINDOW)
        self._proof: deque[tuple[Array, Array, Array]] = deque(maxlen=PROOF)
        self._kept_proof = self._proof.copy(), self.proven

    @property
    def in_use(self) -> CalibrationModel:
        """What predicts now: the adapted model where it is proven to be the better one."""
        return self.model if self.proven else self.trained

    def update(
        self,
        command: Array,
        measured: Array,
        direction: Array | None = None,
        temperatures: Array | None = None,
    ) -> None:
        """Take one measured point; all arrays have shape (1, columns), see `CalibrationModel`."""
        if not np.isfinite(measured).all():
            self.refused += 1
            return
        self._count += 1
        if self._count % JUDGED_EVERY == 0:
            both = [
                measured - m.predict(command, direction, temperatures, warn=False)
                for m in (self.model, self.kept)
            ]
            errors = [float(np.sqrt(np.mean(error**2))) for error in both]
            self._judged.append((errors[0], errors[1]))
            self._errors.append(errors[0])
            self._decide()
            return
        error = measured - self.model.predict(command, direction, temperatures, warn=False)
        if np.max(np.abs(error)) > self._gate():
            self.refused += 1
            return
        unadapted = measured - self.trained.predict(command, direction, temperatures, warn=False)
        self._proof.append((command[0], unadapted[0], error[0]))
        self._prove()
        designs = self.model.linear_design(command, direction, temperatures)
        if not self._estimators:
            self._start(designs)
        weights = []
        for axis, (design, offset) in enumerate(designs):
            target = float((measured - command)[0, axis] - offset[0])
            self._estimators[axis].update(design[0], target)
            weights.append(self._estimators[axis].weights)
        self.model.set_linear_weights(weights)
        assert self.model.domain is not None
        self.model.domain = self.model.domain.with_error(measured - command)
        self.learned += 1

    def _gate(self) -> float:
        """Largest error [m] of a sample that is learned."""
        deviation, noise, _ = self._settings
        held_out = float(np.sqrt(np.mean(np.square(self._errors)))) if self._errors else 0.0
        return GATE * max(deviation, noise, held_out)

    def _prove(self) -> None:
        """Apply the rule of `gain` to the last samples; too few places prove nothing."""
        command, before, after = (np.array(part) for part in zip(*self._proof, strict=True))
        places = distinct_places(command)
        if places.max() + 1 >= FEWEST_PLACES:
            self.proven = held_out_gain(before, after, places).proven

    def _start(self, designs: list[tuple[Array, Array]]) -> None:
        self._estimators = [
            RecursiveLeastSquares(weights, np.maximum(np.abs(design[0]), 0.1), *self._settings)
            for weights, (design, _) in zip(self.model.linear_weights(), designs, strict=True)
        ]

    def _decide(self) -> None:
        adapted, kept = np.sqrt(np.mean(np.square(self._judged), axis=0))
        lost = len(self._judged) > 1 and adapted > FAR_WORSE * kept
        if len(self._judged) < WINDOW and not lost:
            return
        self._judged.clear()
        if adapted > WORSE * kept:
            self.model = copy.deepcopy(self.kept)
            # With its own evidence: what was learned since says nothing about it.
            self._proof, self.proven = self._kept_proof[0].copy(), self._kept_proof[1]
            self._estimators = []
            self.rollbacks += 1
        elif adapted <= kept:
            self.kept = copy.deepcopy(self.model)
            self._kept_proof = self._proof.copy(), self.proven
