"""What every calibration method shares: fit, predict, invert, to_dict, from_dict, describe."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stage_core.errors import StageError

Array = NDArray[np.float64]

MODEL_SCHEMA = 1
"""Version of the dictionary that `to_dict` writes; another one is refused."""


class CalibrationModel(ABC):
    """Forward model of a stage: commanded axes [m] -> measured table point [m].

    A subclass names its method and its options with their defaults, keeps everything that it
    learns in `state` (numbers and arrays only, so that it can be written as JSON) and implements
    `_fit` and `_error`. Arguments of all public functions:

    command, measured, target : (n, axes) [m]
    direction : (n, axes), sign of each axis' last move: -1, 0 (unknown) or +1
    temperatures : (n, sensors) [degC]; where a fitted model is not given any, the means of its
        training stand in
    """

    method: ClassVar[str]
    summary: ClassVar[str]
    defaults: ClassVar[dict[str, Any]] = {}
    continuous: ClassVar[bool] = True
    """False for a model with jumps, whose exact inverse need not exist."""

    def __init__(self, **options: Any) -> None:
        unknown = sorted(set(options) - set(self.defaults))
        if unknown:
            known = ', '.join(sorted(self.defaults)) or 'none'
            raise StageError(
                f'method {self.method} has no option {unknown[0]}: its options are {known}'
            )
        self.options: dict[str, Any] = {**self.defaults, **options}
        self.state: dict[str, Any] = {}
        self.axes = 0
        self.sensors = 0
        self.mean_temperatures: Array = np.empty(0)
        #: For methods that iterate: called with each iteration and the best error so far.
        self.progress: Callable[[int, float], None] | None = None
        #: For methods that iterate: asked after each iteration; True ends the training.
        self.abort: Callable[[], bool] | None = None

    @property
    def fitted(self) -> bool:
        """Whether the model has been fitted or loaded."""
        return self.axes > 0

    @property
    def uses_derivatives(self) -> bool:
        """Whether the temperature columns are readings, then first, then second derivatives."""
        return bool(self.options.get('derivatives', False))

    def parameter_count(self, axes: int, sensors: int) -> int:
        """Number of parameters fitted per output axis; fewer samples are refused."""
        del axes, sensors
        return 1

    def fit(
        self,
        command: ArrayLike,
        measured: ArrayLike,
        direction: ArrayLike | None = None,
        temperatures: ArrayLike | None = None,
    ) -> CalibrationModel:
        """Fit the model and return it.

        Raises
        ------
        StageError
            For shapes that do not agree, a NaN, an axis that never moves, or fewer distinct
            positions than the method has parameters.
        """
        self.axes, self.mean_temperatures = 0, np.empty(0)
        c, d, t = self._checked(command, direction, temperatures)
        m = np.asarray(measured, dtype=float)
        if m.shape != c.shape:
            raise StageError(
                f'command has shape {c.shape} but measured {m.shape}: give one measured point '
                'per commanded one'
            )
        _require_finite(m, 'measured points')
        self._require_information(c, t.shape[1])
        self.state = {}
        self.axes, self.sensors = c.shape[1], t.shape[1]
        self.mean_temperatures = t.mean(axis=0)
        try:
            self._fit(c, m - c, d, t)
        except StageError:
            self.axes = 0
            raise
        return self

    def predict(
        self,
        command: ArrayLike,
        direction: ArrayLike | None = None,
        temperatures: ArrayLike | None = None,
    ) -> Array:
        """Table point that a command reaches, (n, axes) [m]."""
        self._require_fitted()
        c, d, t = self._checked(command, direction, temperatures)
        self._require_shape(c, t)
        return c + self._error(c, d, t)

    def invert(
        self,
        target: ArrayLike,
        direction: ArrayLike | None = None,
        temperatures: ArrayLike | None = None,
        tolerance: float = 1e-9,
        max_iterations: int = 60,
    ) -> Array:
        """Command that reaches the wanted table point, (n, axes) [m].

        Fixed point c <- c + (target - predict(c)), which contracts because a stage's error
        changes by far less than a metre per metre; points that do not settle are finished by
        Newton's method with a finite-difference Jacobian. Direction and temperatures are held.

        Raises
        ------
        StageError
            If the residual of a point stays above `tolerance` [m]. A model with jumps is
            accepted at its best iterate, because an exact inverse need not exist there.
        """
        self._require_fitted()
        wanted, d, t = self._checked(target, direction, temperatures)
        self._require_shape(wanted, t)
        command = wanted.copy()
        best = command.copy()
        best_residual = np.full(len(wanted), np.inf)
        for iteration in range(max_iterations):
            gap = wanted - (command + self._error(command, d, t))
            residual = np.max(np.abs(gap), axis=1)
            better = residual < best_residual
            best[better], best_residual[better] = command[better], residual[better]
            if (best_residual <= tolerance).all():
                return best
            if iteration < max_iterations // 2 or not self.continuous:
                command = command + gap
            else:
                command = best + self._newton_step(best, wanted, d, t)
        if self.continuous:
            worst = int(np.argmax(best_residual))
            raise StageError(
                f'the {self.method} model cannot be inverted at {wanted[worst].tolist()} m '
                f'(residual {best_residual[worst]:.3g} m): use it inside the calibrated travel '
                'or train with a smoother method'
            )
        return best

    def linear_weights(self) -> list[Array]:
        """Weights per output axis that the error depends on linearly.

        Raises
        ------
        StageError
            If the method has none; it cannot be adapted while the stage runs.
        """
        raise _not_linear(self.method)

    def set_linear_weights(self, weights: list[Array]) -> None:
        """Replace the weights of `linear_weights`."""
        raise _not_linear(self.method)

    def linear_design(
        self,
        command: ArrayLike,
        direction: ArrayLike | None = None,
        temperatures: ArrayLike | None = None,
    ) -> list[tuple[Array, Array]]:
        """Per output axis the design (n, p) and offset (n,): error = design @ weights + offset."""
        self._require_fitted()
        c, d, t = self._checked(command, direction, temperatures)
        self._require_shape(c, t)
        return self._linear_design(c, d, t)

    def _linear_design(self, command: Array, d: Array, t: Array) -> list[tuple[Array, Array]]:
        raise _not_linear(self.method)

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

    def _newton_step(self, command: Array, wanted: Array, d: Array, t: Array) -> Array:
        step = 1e-7
        base = command + self._error(command, d, t)
        jacobian = np.empty((len(command), self.axes, self.axes))
        for axis in range(self.axes):
            moved = command.copy()
            moved[:, axis] += step
            jacobian[:, :, axis] = (moved + self._error(moved, d, t) - base) / step
        # A singular Jacobian must not end the loop: other points can still converge.
        flat = np.abs(np.linalg.det(jacobian)) < 1e-6
        jacobian[flat] = np.eye(self.axes)
        return np.asarray(np.linalg.solve(jacobian, (wanted - base)[:, :, None])[:, :, 0], float)

    def _checked(
        self, command: ArrayLike, direction: ArrayLike | None, temperatures: ArrayLike | None
    ) -> tuple[Array, Array, Array]:
        c = np.asarray(command, dtype=float)
        if c.ndim != 2 or c.shape[1] < 1 or len(c) == 0:
            raise StageError(f'points must have shape (n, axes), got {c.shape}')
        _require_finite(c, 'points')
        d = np.zeros_like(c) if direction is None else np.asarray(direction, dtype=float)
        if d.shape != c.shape:
            raise StageError(f'directions have shape {d.shape}, the points {c.shape}')
        _require_finite(d, 'directions')
        if temperatures is None:
            return c, d, np.tile(self.mean_temperatures, (len(c), 1))
        t = np.asarray(temperatures, dtype=float)
        if t.ndim != 2 or len(t) != len(c):
            raise StageError(
                f'temperatures have shape {t.shape}: give one row per point, (n, sensors)'
            )
        for sensor in range(t.shape[1]):
            bad = int(np.count_nonzero(~np.isfinite(t[:, sensor])))
            if bad:
                raise StageError(
                    f'temperature sensor {sensor} dropped out in {bad} of {len(t)} samples: '
                    'repair it or train without temperatures'
                )
        return c, d, t

    def _require_information(self, command: Array, sensors: int) -> None:
        spread = np.ptp(command, axis=0)
        for axis in range(command.shape[1]):
            if spread[axis] <= 0.0:
                raise StageError(
                    f'axis {axis} never moves in the training data: record a session in which '
                    'every axis moves'
                )
        needed = self.parameter_count(command.shape[1], sensors)
        distinct = len(np.unique(command, axis=0))
        if distinct < needed:
            raise StageError(
                f'method {self.method} fits {needed} parameters per axis but the data hold '
                f'{distinct} distinct positions: record more positions or choose a simpler method'
            )

    def _require_fitted(self) -> None:
        if not self.fitted:
            raise StageError(f'the {self.method} model has not been fitted: train it first')

    def _require_shape(self, command: Array, temperatures: Array) -> None:
        if command.shape[1] != self.axes:
            raise StageError(
                f'the model was trained for {self.axes} axes, the points have {command.shape[1]}'
            )
        if self.sensors and temperatures.shape[1] != self.sensors:
            raise StageError(
                f'the model was trained with {self.sensors} temperature columns, got '
                f'{temperatures.shape[1]}: give the same sensors'
            )


def _not_linear(method: str) -> StageError:
    return StageError(
        f'method {method} has no linear weights to adapt: use structured, it2fls or affine'
    )


def scaling_of(values: Array) -> tuple[Array, Array]:
    """Centre and half range per column, so that (values - centre)/half lies in [-1, 1]."""
    low, high = values.min(axis=0), values.max(axis=0)
    half = (high - low) / 2.0
    return (high + low) / 2.0, np.where(half > 0.0, half, 1.0)


def to_json(value: Any) -> Any:
    """Arrays as tagged nested lists; other JSON values unchanged."""
    if isinstance(value, np.ndarray):
        kind = 'int' if value.dtype.kind in 'iub' else 'float'
        return {'array': value.tolist(), 'shape': list(value.shape), 'kind': kind}
    if isinstance(value, dict):
        return {str(key): to_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_json(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    return value


def from_json(value: Any) -> Any:
    """Inverse of :func:`to_json`."""
    if isinstance(value, dict):
        if set(value) == {'array', 'shape', 'kind'}:
            kind = np.int64 if value['kind'] == 'int' else np.float64
            return np.asarray(value['array'], dtype=kind).reshape(value['shape'])
        return {key: from_json(item) for key, item in value.items()}
    if isinstance(value, list):
        return [from_json(item) for item in value]
    return value


def _require_finite(values: Array, what: str) -> None:
    bad = int(np.count_nonzero(~np.isfinite(values).all(axis=-1)))
    if bad:
        raise StageError(
            f'{bad} of {len(values)} {what} are not finite: remove them or record again'
        )
