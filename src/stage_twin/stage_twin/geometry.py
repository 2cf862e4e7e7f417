"""The kinematic link: from motor positions to the table's position."""

from __future__ import annotations

import numpy as np

from stage_twin import hooks
from stage_twin.compiled import compiled
from stage_twin.packing import KernelArrays


@compiled
def table_point(
    arrays: KernelArrays, motor: np.ndarray, played: np.ndarray, rise: np.ndarray, out: np.ndarray
) -> None:
    """Table position (n_axes,) [m] of one instant, written to `out`.

    Errors along each axis first, then those that a carriage makes by its angle and across, at the
    axis positions, then those of the plane. One axis alone has no lateral effect.

    Parameters
    ----------
    motor, played : (n_axes,)
        Motor position, and the position behind the play [m].
    rise : (n_axes,)
        Screw temperature above the reference [K].
    """
    axes = arrays.axes
    none = motor  # these hooks have no states
    count = axes.shape[0]
    for axis in range(count):
        out[axis] = played[axis] + hooks.along(
            axes[axis], none, motor[axis], played[axis], rise[axis]
        )
    if count == 1:
        out[0] += hooks.turn(axes[0], none, out[0], 0.0, -1.0)
        return
    x = out[0]
    y = out[1]
    bent_x = x + hooks.across(axes[1], none, y) + hooks.turn(axes[0], none, x, y, -1.0)
    bent_y = y + hooks.across(axes[0], none, x) + hooks.turn(axes[1], none, y, x, 1.0)
    out[0], out[1] = hooks.plane(arrays.common, none, bent_x, bent_y)


@compiled
def table_path(
    arrays: KernelArrays, motor: np.ndarray, played: np.ndarray, rise: np.ndarray, out: np.ndarray
) -> None:
    """:func:`table_point` for every row of (n, n_axes) arrays."""
    for k in range(motor.shape[0]):
        table_point(arrays, motor[k], played[k], rise[k], out[k])
