"""The kinematic and sensor links alone: a known motor path carried to table and tracker."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stage_core.twin_file import TwinFile
from stage_twin import hooks, layout
from stage_twin.compiled import compiled
from stage_twin.geometry import table_path
from stage_twin.kernel import start_plant
from stage_twin.packing import columns, pack
from stage_twin.tracker import measure


@dataclass(frozen=True)
class CarriedPath:
    """Where a motor path takes the table, and what the tracker sees of it; SI units.

    Attributes
    ----------
    table : (n, n_axes)
    tracker_stamps : (m,), tracker_points : (m, 3)
        As in :class:`stage_twin.simulate.SimulationResult`.
    """

    table: np.ndarray
    tracker_stamps: np.ndarray
    tracker_points: np.ndarray


@compiled
def play_and_heat(
    axes: np.ndarray, period: float, motor: np.ndarray, played: np.ndarray, rise: np.ndarray
) -> None:
    """Play and screw temperature along a motor path (n, n_axes), written to the last two.

    The play starts centred; the screw heats with the mean speed of each tick.
    """
    state = np.zeros((axes.shape[0], layout.STATE_WIDTH))
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
def read_path(axes: np.ndarray, motor: np.ndarray, read: np.ndarray) -> None:
    """What the encoders read, free of their steps, along a motor path (n, n_axes); to `read`."""
    state = np.zeros(layout.STATE_WIDTH)
    for axis in range(axes.shape[0]):
        for k in range(motor.shape[0]):
            read[k, axis] = hooks.read(axes[axis], state, motor[k, axis])


def motor_path(twin: TwinFile, encoder: np.ndarray) -> np.ndarray:
    """Motor path (n, n_axes) [m] behind an encoder (n, n_axes) [m] that errs by little."""
    read = np.empty_like(encoder)
    read_path(pack(twin).axes, encoder, read)
    return 2.0 * encoder - read


def carry(
    twin: TwinFile,
    motor: np.ndarray,
    *,
    temperatures: np.ndarray | None = None,
    seed: int = 0,
    tracker_times: np.ndarray | None = None,
) -> CarriedPath:
    """Carry a motor path to the table and the tracker, for a twin of any kind.

    Parameters
    ----------
    motor : (n, n_axes)
        Encoder or motor steps [m] at the twin's control period.
    temperatures, seed, tracker_times
        As in :func:`stage_twin.simulate.simulate`.

    Raises
    ------
    StageError
        If an array's shape does not fit or the twin is wrong.
    """
    arrays = pack(twin)
    motor = columns('motor', motor, None, arrays)
    played, rise, table = (np.zeros_like(motor) for _ in range(3))
    play_and_heat(arrays.axes, arrays.period, motor, played, rise)
    if temperatures is not None:
        recorded = columns('temperatures', temperatures, motor.shape[0], arrays)
        rise = recorded - twin.temperature_reference
    table_path(arrays.axes, arrays.common, motor, played, rise, table)
    stamps, points = measure(twin, arrays, table, tracker_times, seed, True)
    return CarriedPath(table, stamps, points)
