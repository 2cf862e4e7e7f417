"""From a twin file to the kernel's arrays, every effect checked."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from stage_core.errors import StageError
from stage_core.quantities import split_effect
from stage_core.twin_file import ForceAxis, ServoAxis, StepperAxis, TwinFile
from stage_twin import layout
from stage_twin.discretisation import discretise
from stage_twin.effects import EFFECTS, Effect


@dataclass(frozen=True)
class KernelArrays:
    """A twin as the kernel reads it.

    Attributes
    ----------
    names : tuple of str
        Axis of each row.
    axes : (n_axes, AXIS_WIDTH), common : (COMMON_WIDTH,)
        See :mod:`stage_twin.layout`.
    period : float
        Control period [s].
    transitions, schedule
        See :func:`stage_twin.discretisation.discretise`.
    """

    names: tuple[str, ...]
    axes: np.ndarray
    common: np.ndarray
    period: float
    transitions: np.ndarray
    schedule: np.ndarray

    @property
    def delay_ticks(self) -> int:
        """Whole ticks of the longest delay."""
        return int(self.schedule[:, 0].max())


def effect_values(name: str, given: dict[str, float]) -> tuple[Effect, str | None, dict]:
    """Check one entry of a twin file's `effects`.

    Returns
    -------
    The effect, its axis (None for the machine as a whole) and all its parameters; those not
    given stand at their default.

    Raises
    ------
    StageError
        For an unknown effect or parameter, a missing axis, or a value out of range.
    """
    base, axis = split_effect(name)
    effect = EFFECTS.get(base)
    if effect is None:
        raise StageError(
            f'effect {name} is unknown: `python -m stage_twin.effects` lists what there is'
        )
    if effect.per_axis and axis is None:
        raise StageError(f'effect {name} belongs to an axis: name it {name}.x or {name}.y')
    if not effect.per_axis and axis is not None:
        raise StageError(f'effect {base} belongs to the whole machine: name it without .{axis}')
    values = effect.defaults()
    for key, value in given.items():
        if key not in values:
            known = ', '.join(values)
            raise StageError(f'effect {name} has no parameter {key}: it has {known}')
        parameter = effect.parameter(key)
        if not parameter.minimum <= value <= parameter.maximum:
            raise StageError(
                f'effects.{name}.{key} = {value:g} is out of range: give {parameter.minimum:g} '
                f'to {parameter.maximum:g} {parameter.unit}'.rstrip()
            )
        values[key] = float(value)
    return effect, axis, values


def pack(twin: TwinFile) -> KernelArrays:
    """Kernel arrays of a servo, stepper or measured-force twin.

    A stepper has no servo link: its row holds the lead and the kinematic effects.

    Raises
    ------
    StageError
        See :func:`effect_values`; also where an effect names an axis that the twin lacks, or
        the moving mass or the viscous friction would become negative.
    """
    names = tuple(twin.axes)
    axes = np.zeros((len(names), layout.AXIS_WIDTH))
    common = np.zeros(layout.COMMON_WIDTH)
    for index, name in enumerate(names):
        _base_row(twin.axes[name], axes[index])
    for name, given in twin.effects.items():
        effect, axis, values = effect_values(name, given)
        if twin.kind == 'stepper' and effect.link == 'servo':
            raise StageError(f'effect {name} needs a servo link: a stepper twin has none')
        if axis is None:
            for key, value in values.items():
                common[layout.COMMON_SLOTS[effect.name, key]] = value
        elif axis not in names:
            raise StageError(f'effect {name}: the twin has no axis {axis}, only {list(names)}')
        else:
            for key, value in values.items():
                axes[names.index(axis), layout.AXIS_SLOTS[effect.name, key]] = value
    for row in axes:
        _change_controller(row)
    _check_friction(names, axes)
    transitions = np.zeros(
        (len(names), layout.PIECES, layout.DIRECTIONS, layout.MOTION, layout.MOTION + 1)
    )
    schedule = np.zeros((len(names), 2 + 2 * layout.PIECES))
    if twin.kind != 'stepper':
        discretise(axes, twin.control_period, transitions, schedule)
    return KernelArrays(names, axes, common, twin.control_period, transitions, schedule)


def _base_row(axis: ServoAxis | StepperAxis | ForceAxis, row: np.ndarray) -> None:
    given = {f.name for f in fields(axis)}
    for column, name in enumerate(layout.AXIS_FIELDS):
        if name in given:
            row[column] = getattr(axis, name)
    if isinstance(axis, StepperAxis):
        row[layout.ENCODER_RESOLUTION] = axis.microstep


def _change_controller(row: np.ndarray) -> None:
    """Gains and limit of a controller that is not the file's."""
    for gain, error in layout.CONTROLLER_ERRORS:
        row[gain] *= 1.0 + row[error]
    row[layout.VELOCITY_FEEDFORWARD] += row[layout.FEEDFORWARD_ERROR]
    if row[layout.SATURATION_KNOWN] > 0.5 and row[layout.SATURATION] > 0.0:
        row[layout.FORCE_LIMIT] = min(row[layout.FORCE_LIMIT], row[layout.SATURATION])


def _check_friction(names: tuple[str, ...], axes: np.ndarray) -> None:
    for name, row in zip(names, axes, strict=True):
        fixed = row[layout.VISCOUS] + row[layout.VISCOUS_ADDED]
        least = fixed + min(row[layout.VISCOUS_POSITIVE], row[layout.VISCOUS_NEGATIVE])
        if least < 0.0:
            raise StageError(
                f'axis {name}: viscous friction comes to {least:g} N·s/m: keep it at or above 0'
            )


def columns(name: str, values: np.ndarray, count: int | None, arrays: KernelArrays) -> np.ndarray:
    """An input of n ticks as a contiguous (n, n_axes) array of floats.

    Raises
    ------
    StageError
        If its shape is another, n is not `count`, or values are not finite.
    """
    values = np.ascontiguousarray(values, dtype=float)
    width = len(arrays.names)
    fits = values.ndim == 2 and values.shape[1] == width and values.shape[0] > 0
    if not fits or count not in (None, values.shape[0]):
        rows = 'n' if count is None else str(count)
        raise StageError(f'{name} has shape {values.shape}: give ({rows}, {width})')
    if not np.isfinite(values).all():
        raise StageError(f'{name} holds values that are not finite: remove them first')
    return values
