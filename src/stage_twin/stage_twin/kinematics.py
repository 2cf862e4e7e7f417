"""The kinematic link alone: a known motor path carried to the table."""

from __future__ import annotations

import numpy as np

from stage_core.twin_file import TwinFile
from stage_twin import hooks, layout
from stage_twin.compiled import compiled
from stage_twin.geometry import table_path
from stage_twin.kernel import start_plant
from stage_twin.packing import KernelArrays, Work, columns, pack


@compiled
def play_and_heat(
    arrays: KernelArrays,
    state: np.ndarray,
    motor: np.ndarray,
    played: np.ndarray,
    rise: np.ndarray,
) -> None:
    """Play and screw temperature along a motor path (n, n_axes), written to the last two.

    The play starts centred; the screw heats with the mean speed of each tick.
    """
    axes, period = arrays.axes, arrays.period
    start_plant(axes, motor[0], state)
    for axis in range(axes.shape[0]):
        row = axes[axis]
        own = state[axis]
        played[0, axis] = own[layout.PLAYED]
        rise[0, axis] = own[layout.RISE]
        for k in range(1, motor.shape[0]):
            position = motor[k, axis]
            velocity = (position - motor[k - 1, axis]) / period
            played[k, axis] = hooks.follow(row, own, position, velocity, period, k * period)
            rise[k, axis] = hooks.heat(row, own, velocity, period)


@compiled
def read_path(axes: np.ndarray, state: np.ndarray, motor: np.ndarray, read: np.ndarray) -> None:
    """What the encoders read, free of their steps, along a motor path (n, n_axes); to `read`."""
    for axis in range(axes.shape[0]):
        for k in range(motor.shape[0]):
            read[k, axis] = hooks.read(axes[axis], state[axis], motor[k, axis])


def motor_path(twin: TwinFile, encoder: np.ndarray) -> np.ndarray:
    """Motor path (n, n_axes) [m] behind an encoder (n, n_axes) [m] that errs by little."""
    read = np.empty_like(encoder)
    axes = pack(twin).axes
    read_path(axes, Work.of(len(axes)).state, encoder, read)
    return 2.0 * encoder - read


def carry(twin: TwinFile, motor: np.ndarray, temperatures: np.ndarray | None = None) -> np.ndarray:
    """Table positions (n, n_axes) [m] of a motor path, for a twin of any kind.

    Parameters
    ----------
    motor : (n, n_axes)
        Encoder or motor steps [m] at the twin's control period.
    temperatures
        As in :func:`stage_twin.simulate.simulate`.

    Raises
    ------
    StageError
        If an array's shape does not fit or the twin is wrong.
    """
    arrays = pack(twin)
    motor = columns('motor', motor, None, arrays)
    played, rise, table = (np.zeros_like(motor) for _ in range(3))
    play_and_heat(arrays, Work.of(len(arrays.axes)).state, motor, played, rise)
    if temperatures is not None:
        recorded = columns('temperatures', temperatures, motor.shape[0], arrays)
        rise = recorded - twin.temperature_reference
    table_path(arrays, motor, played, rise, table)
    return table
