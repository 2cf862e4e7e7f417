"""What every calibration method shares: fit, predict, invert, to_dict, from_dict, describe."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from calibrator.models.domain import Domain
from calibrator.models.encoding import from_json, to_json
from calibrator.models.inputs import checked, require_finite
from calibrator.models.inverse import TOLERANCE, invert
from calibrator.models.options import checked_options
from calibrator.models.selection import Conditions, Learner, choose, conditions, deviation
from calibrator.places import Labels, distinct_places
from stage_core.arrays import Array
from stage_core.errors import StageError

MODEL_SCHEMA = 2
"""Version of the dictionary that `to_dict` writes; another one is refused."""


class CalibrationModel(ABC):
    """Forward model of a stage: commanded axes [m] -> measured table point [m].

    A subclass names its method and its options with their defaults, keeps everything that it
    learns in `state` (numbers and arrays only, so that it can be written as JSON) and implements
    `_fit` and `_error`. What it leaves to the data it lists in `candidates`; `fit` chooses among
    them by what it leaves out (`selection`). Beyond its `domain` no model extrapolates. Arguments
    of all public functions:

    command, measured, target : (n, axes) [m]
    direction : (n, axes), sign of each axis' last move: -1, 0 (unknown) or +1
    temperatures : (n, sensors) [degC]; where a fitted model is not given any, the means of its
        training stand in
    """

    method: ClassVar[str]
    summary: ClassVar[str]
    defaults: ClassVar[dict[str, Any]] = {}
    choices: ClassVar[dict[str, Sequence[int]]] = {}
    """What the data choose among for an option that is `auto`, the simplest first."""
    continuous: ClassVar[bool] = True
    """False for a model with jumps, whose exact inverse need not exist."""
    thermal: ClassVar[bool] = False
    """Whether temperatures are inputs of the method."""

    def __init__(self, **options: Any) -> None:
        checked_options(self.method, options, self.defaults)
        self.options: dict[str, Any] = {**self.defaults, **options}
        self.state: dict[str, Any] = {}
        #: What the data chose, by the name of the option.
        self.chosen: dict[str, Any] = {}
        self.domain: Domain | None = None
        self.axes = 0
        self.sensors = 0
        self.mean_temperatures: Array = np.empty(0)
        #: Labels (n,) of the sessions that the samples at hand are of, where there are several.
        self.sessions: list[Labels] = []
        #: Standard deviation (axes,) [m] of predictions inside the domain.
        self.spread: Array = np.empty(0)
        #: For methods that iterate: called with each iteration and the best error so far.
        self.progress: Callable[[int, float], None] | None = None

    @property
    def fitted(self) -> bool:
        """Whether the model has been fitted or loaded."""
        return self.axes > 0

    @property
    def uses_derivatives(self) -> bool:
        """Whether the temperature columns are readings, then first, then second derivatives."""
        return bool(self.options.get('derivatives', False))

    def setting(self, name: str) -> Any:
        """What the data chose for an option, else what the user did."""
        return self.chosen.get(name, self.options[name])

    def candidates(self) -> list[dict[str, Any]]:
        """Settings of the option that is `auto`, the simplest first."""
        for name, values in self.choices.items():
            if self.options[name] == 'auto':
                return [{name: value} for value in values]
        return [{}]

    def parameter_count(self, axes: int, sensors: int) -> int:
        """Number of parameters fitted per output axis; fewer distinct places are refused."""
        return 1

    def fit(
        self,
        command: ArrayLike,
        measured: ArrayLike,
        direction: ArrayLike | None = None,
        temperatures: ArrayLike | None = None,
        session: ArrayLike | None = None,
    ) -> CalibrationModel:
        """Fit the means of repeats; `session` (n,) tells samples of several sessions apart.

        Raises
        ------
        StageError
            For shapes that do not agree, a NaN, an axis that never moves, or fewer distinct
            places than the method has parameters.
        """
        self.axes, self.mean_temperatures = 0, np.empty(0)
        c, d, t = checked(command, direction, temperatures, self.mean_temperatures)
        m = np.asarray(measured, dtype=float)
        if m.shape != c.shape:
            raise StageError(
                f'command has shape {c.shape} but measured {m.shape}: give one measured point '
                'per commanded one'
            )
        require_finite(m, 'measured points')
        number = None if session is None else np.asarray(session, dtype=float)
        data = conditions(c, m - c, d, t if self.thermal else t[:, :0], number)
        self.chosen = {}
        self._require_information(data)
        candidates = self._feasible(data)
        left_out = data.error
        try:
            self.chosen, left_out = choose(candidates, self._learner, data)
        except StageError:
            # A setting of the user's stands, though the data do not suffice to judge it.
            if len(candidates) > 1:
                raise
            self.chosen = candidates[0]
        self.spread = deviation(left_out)
        return self.learn(data)

    def learn(self, data: Conditions) -> CalibrationModel:
        """Fit the settings at hand to conditions, without a choice, and return the model.

        Raises
        ------
        StageError
            As `fit`.
        """
        if not self.chosen.get('sensors', True):
            data = replace(data, temperatures=data.temperatures[:, :0])
        self.axes = 0
        self._require_information(data)
        self.state = {}
        numbers = np.unique(data.session, return_inverse=True)[1].reshape(-1)
        self.sessions = [numbers] if numbers.max() > 0 else []
        self.axes, self.sensors = data.command.shape[1], data.temperatures.shape[1]
        self.mean_temperatures = data.temperatures.mean(axis=0)
        self.domain = Domain.of(data.command, data.error, data.temperatures)
        try:
            self._fit(data.command, data.error, data.direction, data.temperatures)
        except StageError:
            self.axes = 0
            raise
        return self

    def _feasible(self, data: Conditions) -> list[dict[str, Any]]:
        """The candidates that the places suffice for, without and with temperatures."""
        sensors = data.temperatures.shape[1]
        heats: list[dict[str, Any]] = [{}]
        if sensors:
            heats = [{'sensors': False}, {'sensors': True}]
        places = int(distinct_places(data.command).max()) + 1
        listed, found = self.candidates(), []
        for heat in heats:
            for chosen in listed:
                self.chosen = chosen
                used = sensors if heat.get('sensors') else 0
                needed = self.parameter_count(data.command.shape[1], used)
                if len(listed) == 1 or needed <= places:
                    found.append({**chosen, **heat})
        if not found:
            self.chosen = listed[0]
            self._require_information(data)
        self.chosen = {}
        return found

    def _learner(self, chosen: dict[str, Any]) -> Learner:
        def learn(rest: Conditions) -> Callable[[Conditions], Array]:
            other = type(self)(**self.options)
            other.chosen, other.progress = chosen, self.progress
            other.learn(rest)
            return lambda held: other.error(
                held.command, held.direction, held.temperatures[:, : other.sensors]
            )

        return learn

    def predict(
        self,
        command: ArrayLike,
        direction: ArrayLike | None = None,
        temperatures: ArrayLike | None = None,
        warn: bool = True,
    ) -> Array:
        """Table point that a command reaches, (n, axes) [m]; a warning names what is beyond.

        Beyond the domain the model does not extrapolate, see `Domain.guard`.
        """
        c, d, t = self._of_the_fit(command, direction, temperatures)
        assert self.domain is not None
        if warn and (reason := self.domain.beyond(c, t)):
            warnings.warn(reason, stacklevel=2)
        return c + self.error(c, d, t)

    def deviation(self, command: ArrayLike) -> Array:
        """Standard deviation of each prediction, (n, axes) [m].

        Its 95 % interval, 1.96 of it to either side, holds 95 % of what was left out in training.
        """
        c, _, _ = self._of_the_fit(command, None, None)
        assert self.domain is not None
        return self.domain.deviation(c, self.spread)

    def error(self, command: Array, direction: Array, temperatures: Array) -> Array:
        """Predicted error, (n, axes) [m], of arrays that were checked."""
        assert self.domain is not None
        return self.domain.guard(
            lambda held, heat: self._error(held, direction, heat), command, temperatures
        )

    def invert(
        self,
        target: ArrayLike,
        direction: ArrayLike | None = None,
        temperatures: ArrayLike | None = None,
    ) -> Array:
        """Command that reaches the wanted table point, (n, axes) [m].

        See `inverse.invert`; direction and temperatures are held.

        Raises
        ------
        StageError
            If the residual of a point stays above `inverse.TOLERANCE`. A model with jumps is
            accepted at its best iterate, because an exact inverse need not exist there.
        """
        wanted, d, t = self._of_the_fit(target, direction, temperatures)
        command, residual = invert(lambda c: self.error(c, d, t), wanted, self.continuous)
        worst = int(np.argmax(residual))
        if self.continuous and residual[worst] > TOLERANCE:
            raise StageError(
                f'the {self.method} model cannot be inverted at {wanted[worst].tolist()} m '
                f'(residual {residual[worst]:.3g} m): use it inside the calibrated travel '
                'or train with a smoother method'
            )
        return command

    def to_dict(self) -> dict[str, Any]:
        """Everything needed to rebuild the model, JSON types only."""
        self._require_fitted()
        return {
            'schema': MODEL_SCHEMA,
            'method': self.method,
            'options': dict(self.options),
            'axes': self.axes,
            'sensors': self.sensors,
            'mean_temperatures': self.mean_temperatures.tolist(),
            'chosen': self.chosen,
            'deviation': self.spread.tolist(),
            'domain': to_json(vars(self.domain)),
            'state': to_json(self.state),
        }

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> CalibrationModel:
        """Rebuild a model that `to_dict` wrote.

        Raises
        ------
        StageError
            If the dictionary is of another method or schema, or incomplete.
        """
        if content.get('schema') != MODEL_SCHEMA or content.get('method') != cls.method:
            raise StageError(
                f'the model is of schema {content.get("schema")}, method {content.get("method")}; '
                f'schema {MODEL_SCHEMA} and method {cls.method} expected: train it again'
            )
        try:
            model = cls(**content['options'])
            model.axes, model.sensors = int(content['axes']), int(content['sensors'])
            model.mean_temperatures = np.asarray(content['mean_temperatures'], dtype=float)
            model.chosen = dict(content['chosen'])
            model.spread = np.asarray(content['deviation'], dtype=float)
            model.domain = Domain(**from_json(content['domain']))
            model.state = from_json(content['state'])
            if model.axes < 1:
                raise ValueError('no axis')
        except (KeyError, TypeError, ValueError) as error:
            raise StageError(
                f'the {cls.method} model is incomplete ({error!r}): train it again'
            ) from error
        return model

    def describe(self) -> str:
        """One line on the model for a person."""
        if not self.fitted:
            return f'{self.method}: {self.summary} (not fitted)'
        return f'{self.method}: {self.summary}'

    @abstractmethod
    def _fit(self, command: Array, error: Array, direction: Array, temperatures: Array) -> None:
        """Learn error = measured - command, (n, axes) [m], into `state`."""

    @abstractmethod
    def _error(self, command: Array, direction: Array, temperatures: Array) -> Array:
        """Predicted error, (n, axes) [m]."""

    def _require_information(self, data: Conditions) -> None:
        spread = np.ptp(data.command, axis=0)
        for axis in range(data.command.shape[1]):
            if spread[axis] <= 0.0:
                raise StageError(
                    f'axis {axis} never moves in the training data: record a session in which '
                    'every axis moves'
                )
        needed = self.parameter_count(data.command.shape[1], data.temperatures.shape[1])
        distinct = int(distinct_places(data.command).max()) + 1
        if distinct < needed:
            raise StageError(
                f'method {self.method} fits {needed} parameters per axis but the data hold '
                f'{distinct} distinct positions: record more positions or choose a simpler method'
            )

    def _require_fitted(self) -> None:
        if not self.fitted:
            raise StageError(f'the {self.method} model has not been fitted: train it first')

    def _of_the_fit(
        self, command: ArrayLike, direction: ArrayLike | None, temperatures: ArrayLike | None
    ) -> tuple[Array, Array, Array]:
        """Checked arrays of a fitted model."""
        self._require_fitted()
        c, d, t = checked(command, direction, temperatures, self.mean_temperatures)
        if c.shape[1] != self.axes:
            raise StageError(
                f'the model was trained for {self.axes} axes, the points have {c.shape[1]}'
            )
        if self.sensors and t.shape[1] != self.sensors:
            raise StageError(
                f'the model was trained with {self.sensors} temperature columns, got '
                f'{t.shape[1]}: give the same sensors'
            )
        return c, d, t if self.sensors else t[:, :0]
