"""The kinematic link: from motor positions to the table's position."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stage_twin import layout as at


@njit(cache=True)
def along_axis(row: np.ndarray, motor: float, played: float, rise: float) -> float:
    """Position along one axis [m]: play, scale, cyclic pitch error and heat.

    Parameters
    ----------
    motor, played : float
        Motor position, and what the play operator leaves of it [m].
    rise : float
        Screw temperature above the reference [K].
    """
    position = played * (1.0 + row[at.SCALE])
    if row[at.CYCLIC_AMPLITUDE] != 0.0:
        period = (
            row[at.CYCLIC_PERIOD] if row[at.CYCLIC_PERIOD] > at.SHORTEST_LENGTH else row[at.LEAD]
        )
        position += row[at.CYCLIC_AMPLITUDE] * math.sin(
            2.0 * math.pi * motor / period + row[at.CYCLIC_PHASE]
        )
    if row[at.EXPANSION] != 0.0:
        position += row[at.EXPANSION] * rise * (played - row[at.FIXED_POINT])
    return position


@njit(cache=True)
def straightness(row: np.ndarray, position: float) -> float:
    """Displacement of the other axis [m]."""
    if row[at.STRAIGHT_QUADRATIC] == 0.0 and row[at.STRAIGHT_CUBIC] == 0.0:
        return 0.0
    s = (position - row[at.STRAIGHT_CENTRE]) / row[at.STRAIGHT_HALF]
    second = 0.5 * (3.0 * s * s - 1.0)
    third = 0.5 * (5.0 * s * s - 3.0) * s
    return row[at.STRAIGHT_QUADRATIC] * second + row[at.STRAIGHT_CUBIC] * third


@njit(cache=True)
def yaw(row: np.ndarray, position: float) -> float:
    """Yaw of the carriage [rad]."""
    if row[at.YAW_LINEAR] == 0.0 and row[at.YAW_QUADRATIC] == 0.0:
        return 0.0
    s = (position - row[at.YAW_CENTRE]) / row[at.YAW_HALF]
    return row[at.YAW_LINEAR] * s + row[at.YAW_QUADRATIC] * 0.5 * (3.0 * s * s - 1.0)


@njit(cache=True)
def table_point(
    axes: np.ndarray,
    common: np.ndarray,
    motor: np.ndarray,
    played: np.ndarray,
    rise: np.ndarray,
    out: np.ndarray,
) -> None:
    """Table position (n_axes,) [m] of one instant, written to `out`.

    Axis errors first, then yaw and straightness at the axis positions, then squareness
    x_t = x - sin(phi) y, y_t = cos(phi) y. One axis alone has no lateral effect.
    """
    count = axes.shape[0]
    for axis in range(count):
        out[axis] = along_axis(axes[axis], motor[axis], played[axis], rise[axis])
    if count == 1:
        out[0] -= yaw(axes[0], out[0]) * axes[0, at.YAW_ARM]
        return
    x = out[0]
    y = out[1]
    bent_x = x + straightness(axes[1], y) - yaw(axes[0], x) * (y + axes[0, at.YAW_ARM])
    bent_y = y + straightness(axes[0], x) + yaw(axes[1], y) * (x + axes[1, at.YAW_ARM])
    angle = common[at.SQUARENESS]
    out[0] = bent_x - math.sin(angle) * bent_y
    out[1] = math.cos(angle) * bent_y


@njit(cache=True)
def table_path(
    axes: np.ndarray,
    common: np.ndarray,
    motor: np.ndarray,
    played: np.ndarray,
    rise: np.ndarray,
    out: np.ndarray,
) -> None:
    """:func:`table_point` for every row of (n, n_axes) arrays."""
    for k in range(motor.shape[0]):
        table_point(axes, common, motor[k], played[k], rise[k], out[k])
