"""From a twin file to the kernel's arrays, every effect checked."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stage_core.errors import StageError
from stage_core.names import nearest
from stage_core.quantities import split_effect
from stage_core.twin_file import ForceAxis, ServoAxis, StepperAxis, TwinFile
from stage_twin import hooks, layout
from stage_twin.discretisation import discretise
from stage_twin.effects import EFFECTS, Effect


class KernelArrays(NamedTuple):
    """A twin as the kernels take it; its rows are the twin's axes in their order.

    Attributes
    ----------
    axes : (n_axes, AXIS_WIDTH), common : (COMMON_WIDTH,)
        See :mod:`stage_twin.layout`.
    period : float
        Control period [s].
    transitions, schedule
        See :func:`stage_twin.discretisation.discretise`.
    """

    axes: np.ndarray
    common: np.ndarray
    period: float
    transitions: np.ndarray
    schedule: np.ndarray


class Work(NamedTuple):
    """What a compiled loop over a machine works in, as it allocates nothing.

    Attributes
    ----------
    state : (n_axes, STATE_WIDTH), controller : (n_axes, CONTROLLER_WIDTH)
        See :mod:`stage_twin.layout`.
    encoders, external : (n_axes,)
        Readings [m], and forces from outside [N].
    """

    state: np.ndarray
    controller: np.ndarray
    encoders: np.ndarray
    external: np.ndarray

    @classmethod
    def of(cls, axes: int) -> Work:
        """For a machine of so many axes."""
        widths = (layout.STATE_WIDTH,), (layout.CONTROLLER_WIDTH,), (), ()
        return cls(*(np.zeros((axes, *width)) for width in widths))


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
            f'effect {name} is unknown (`python -m stage_twin.effects` lists them): '
            f'{nearest(base, EFFECTS)}'
        )
    if effect.per_axis and axis is None:
        raise StageError(f'effect {name} belongs to an axis: name it {name}.x or {name}.y')
    if not effect.per_axis and axis is not None:
        raise StageError(f'effect {base} belongs to the whole machine: name it without .{axis}')
    values = effect.defaults()
    for key, value in given.items():
        if key not in values:
            raise StageError(f'effect {name} has no parameter {key}: {nearest(key, values)}')
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
    rows = np.zeros((len(names), layout.AXIS_WIDTH))
    common = np.zeros(layout.COMMON_WIDTH)
    fields = {name: _fields(axis) for name, axis in twin.axes.items()}
    for effect, axis, values in _in_order(twin):
        if axis is not None and axis not in names:
            raise StageError(
                f'effect {effect.name}.{axis}: the twin has no axis {axis}, only {list(names)}'
            )
        row = common if axis is None else rows[names.index(axis)]
        slots = layout.COMMON_SLOTS if axis is None else layout.AXIS_SLOTS
        for key, value in values.items():
            row[slots[effect.name, key]] = value
        if effect.is_on(values):
            hooks.switch(effect, row)
            if axis is not None:
                hooks.prepare(effect, fields[axis], values)
    for row, name in zip(rows, names, strict=True):
        row[: len(layout.AXIS_FIELDS)] = list(fields[name].values())
    _check_friction(fields)
    transitions = np.zeros(
        (len(names), layout.PIECES, layout.DIRECTIONS, layout.MOTION, layout.MOTION + 1)
    )
    schedule = np.zeros((len(names), layout.SCHEDULE_WIDTH))
    if twin.kind != 'stepper':
        discretise(rows, twin.control_period, transitions, schedule)
    return KernelArrays(rows, common, twin.control_period, transitions, schedule)


def _in_order(twin: TwinFile) -> list[tuple[Effect, str | None, dict[str, float]]]:
    """The twin's effects, checked, in the order in which they act."""
    checked = [effect_values(name, given) for name, given in twin.effects.items()]
    for effect, axis, _ in checked:
        if twin.kind == 'stepper' and effect.link == 'servo':
            raise StageError(
                f'effect {effect.name}.{axis} needs a servo link: a stepper twin has none'
            )
    return sorted(checked, key=lambda entry: entry[0].order)


def _fields(axis: ServoAxis | StepperAxis | ForceAxis) -> dict[str, float]:
    """Fields of an axis' row as the twin file has them; zero where its kind has none."""
    values = {name: float(getattr(axis, name, 0.0)) for name in layout.AXIS_FIELDS}
    if isinstance(axis, StepperAxis):
        values['encoder_resolution'] = axis.microstep
    return values


def _check_friction(axes: dict[str, dict[str, float]]) -> None:
    for name, axis in axes.items():
        least = axis['viscous'] + min(axis['viscous_positive'], axis['viscous_negative'])
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
    width = len(arrays.axes)
    fits = values.ndim == 2 and values.shape[1] == width and values.shape[0] > 0
    if not fits or count not in (None, values.shape[0]):
        rows = 'n' if count is None else str(count)
        raise StageError(f'{name} has shape {values.shape}: give ({rows}, {width})')
    if not np.isfinite(values).all():
        raise StageError(f'{name} holds values that are not finite: remove them first')
    return values
