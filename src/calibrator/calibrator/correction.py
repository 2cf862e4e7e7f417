"""The correction in the command path: from a wanted table point to the set-point."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from calibrator.model_file import StoredModel
from calibrator.temperatures import silence
from stage_core.errors import StageError
from stage_core.rests import REFERENCE_BAND

Array = NDArray[np.float64]


class Correction:
    """Applies the inverse of a model while it is active, the identity otherwise."""

    def __init__(self, max_correction: float) -> None:
        self.max_correction = max_correction
        self.stored: StoredModel | None = None
        self.active = False
        self.largest = 0.0
        #: Why the last target is corrected by less than a model knows; empty inside its domain.
        self.beyond = ''
        self._last: Array | None = None
        self._direction: Array | None = None

    def activate(self, active: bool) -> None:
        """Switch the correction.

        Raises
        ------
        StageError
            If there is no model to apply, or only one that was written by force.
        """
        if active and self.stored is None:
            raise StageError('there is no model to activate: call ~/retrain or ~/load first')
        if active and self.stored is not None and self.stored.refusal:
            raise StageError(f'the model was written by force: {self.stored.refusal}')
        self.active = active

    def apply(
        self,
        target: Array,
        temperatures: dict[str, float] | None = None,
        rates: dict[str, tuple[float, float]] | None = None,
    ) -> Array:
        """Set-point (axes,) [m] for a wanted table point (axes,) [m].

        `temperatures` [degC] and their derivatives `rates` [K/s] and [K/s2] by sensor, of the
        sensors that are heard.

        Raises
        ------
        StageError
            If the point is not finite, the model has other axes, needs a sensor that is silent,
            cannot be inverted there, or the correction exceeds `max_correction`: the stage must
            not go there.
        """
        wanted = np.asarray(target, dtype=float)
        if not np.isfinite(wanted).all():
            raise StageError('the wanted table point is not finite: the target is ignored')
        self._follow(wanted)
        self.beyond = ''
        if not self.active or self.stored is None:
            return wanted
        if reason := self.silence(temperatures or {}):
            raise StageError(reason)
        # The means of the training until enough readings were heard for a derivative.
        heat = self.stored.temperature_row(temperatures or {}, rates or {})
        command = self.stored.invert(wanted[None], self._direction, heat)[0]
        self.beyond = self.stored.beyond(wanted[None], heat)
        correction = float(np.max(np.abs(command - wanted)))
        if correction > self.max_correction:
            raise StageError(
                f'the correction at {wanted.tolist()} m is {1e6 * correction:.1f} µm, beyond '
                f'max_correction {1e6 * self.max_correction:.1f} µm: the target is ignored; '
                'retrain, or raise max_correction'
            )
        self.largest = max(self.largest, correction)
        return command

    def _follow(self, wanted: Array) -> None:
        """Keep the sign of each axis' last move, which the play of a screw depends on."""
        if self._last is None or self._last.shape != wanted.shape:
            self._direction = np.zeros((1, len(wanted)))
        else:
            step = wanted - self._last
            assert self._direction is not None
            self._direction = np.where(
                np.abs(step) < REFERENCE_BAND, self._direction, np.sign(step)
            )
        self._last = wanted.copy()

    def silence(self, temperatures: Iterable[str]) -> str:
        """Why targets are refused while only these sensors are heard; empty where they are not.

        Neither the last reading of a silent sensor nor the mean of the training is its temperature
        now: the correction would be wrong by the growth of the screws, and nobody would see it.
        """
        if not self.active or self.stored is None:
            return ''
        return silence(self.stored.sensors, temperatures)
