"""The correction in the command path: from a wanted table point to the set-point."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from calibrator.model_file import StoredModel
from calibrator.prepare import last_moves
from calibrator.temperatures import silence
from stage_core.arrays import Array
from stage_core.errors import StageError

ELSEWHERE = 1e-6
"""Further than this [m] from where it was sent, the stage is on its way or was moved by others."""


class Correction:
    """Applies the inverse of a model while it is active, the identity otherwise."""

    def __init__(self, max_correction: float) -> None:
        self.max_correction = max_correction
        self.stored: StoredModel | None = None
        self.active = False
        self.largest = 0.0
        #: Why the last target is corrected by less than a model knows; empty inside its domain.
        self.beyond = ''
        #: The last target, its set-point and the signs of the moves to it.
        self._last: tuple[Array, Array, Array] | None = None

    def activate(self, active: bool) -> None:
        """Switch the correction.

        Raises
        ------
        StageError
            If there is no model to apply, or only one that must not correct.
        """
        if active and self.stored is None:
            raise StageError('there is no model to activate: call ~/retrain or ~/load first')
        if active and self.stored is not None and self.stored.refusal:
            raise StageError(f'the model must not correct: {self.stored.refusal}')
        self.active = active

    def apply(
        self,
        target: Array,
        temperatures: dict[str, float] | None = None,
        rates: dict[str, tuple[float, float]] | None = None,
        standing: tuple[Array, Array] | None = None,
    ) -> Array:
        """Set-point (axes,) [m] for a wanted table point (axes,) [m].

        `temperatures` [degC] and their derivatives `rates` [K/s] and [K/s2] by sensor, of the
        sensors that are heard; `standing` where the stage's reference is (axes,) [m] and the
        signs of its last moves.

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
        direction = self._approach(wanted, standing)
        self.beyond = ''
        command = wanted
        if self.active and self.stored is not None:
            command = self._corrected(self.stored, wanted, direction, temperatures, rates)
        # Only now: the stage does not go to a target that is refused.
        self._last = wanted.copy(), command, direction
        return command

    def _corrected(
        self,
        stored: StoredModel,
        wanted: Array,
        direction: Array,
        temperatures: dict[str, float] | None,
        rates: dict[str, tuple[float, float]] | None,
    ) -> Array:
        if reason := self.silence(temperatures or {}):
            raise StageError(reason)
        # The means of the training until enough readings were heard for a derivative.
        heat = stored.temperature_row(temperatures or {}, rates or {})
        most = self.max_correction
        command = np.asarray(stored.invert(wanted[None], direction[None], heat, most)[0])
        self.beyond = stored.beyond(wanted[None], heat)
        self.largest = max(self.largest, float(np.max(np.abs(command - wanted))))
        return command

    def _approach(self, wanted: Array, standing: tuple[Array, Array] | None) -> Array:
        """Signs (axes,) of the moves to a target, which the play of a screw depends on."""
        start, sent, held = wanted, wanted, np.zeros(len(wanted))
        if self._last is not None and len(self._last[0]) == len(wanted):
            start, sent, held = self._last
        elif standing is not None:
            start, sent, held = standing[0], *standing
        if standing is not None:
            at, came = standing
            elsewhere = np.abs(at - sent) > ELSEWHERE
            start = np.where(elsewhere, at - (sent - start), start)
            held = np.where(elsewhere, came, held)
        return last_moves(wanted - start, held)

    def silence(self, temperatures: Iterable[str]) -> str:
        """Why targets are refused while only these sensors are heard; empty where they are not.

        Neither the last reading of a silent sensor nor the mean of the training is its temperature
        now: the correction would be wrong by the growth of the screws, and nobody would see it.
        """
        if not self.active or self.stored is None:
            return ''
        return silence(self.stored.sensors, temperatures)
