"""Compiled loops over a whole session."""

from __future__ import annotations

import numpy as np

from stage_twin import layout as at
from stage_twin.compiled import compiled
from stage_twin.kernel import (
    advance,
    encoder,
    estimate_velocity,
    start_controller,
    start_plant,
    velocity_command,
    velocity_loop,
)
from stage_twin.packing import KernelArrays, Work


@compiled
def run_session(
    arrays: KernelArrays,
    work: Work,
    start: np.ndarray,
    reference: np.ndarray,
    reference_velocity: np.ndarray,
    compensation: np.ndarray,
    force: np.ndarray,
    channels: np.ndarray,
) -> None:
    """Simulate a session from rest.

    Parameters
    ----------
    reference, reference_velocity, compensation : (n, n_axes)
    force : (n_axes, n), written
        Force commands of the controller.
    channels : (6, n, n_axes), written
        Encoder q, filtered velocity vf, velocity command vc, motor (table-side) position,
        that position behind the play, rise of the screw's temperature [K].
    """
    axes, period = arrays.axes, arrays.period
    count, width = reference.shape
    state, controller, encoders, external = work
    start_plant(axes, start, state)
    for axis in range(width):
        encoders[axis] = encoder(axes[axis], state[axis])
    start_controller(encoders, controller)
    for k in range(count):
        for axis in range(width):
            row = axes[axis]
            q = encoder(row, state[axis])
            filtered = estimate_velocity(row, period, controller[axis], q)
            command = velocity_command(row, q, reference[k, axis], reference_velocity[k, axis])
            command += compensation[k, axis]
            force[axis, k] = velocity_loop(row, period, controller[axis], command)
            channels[0, k, axis] = q
            channels[1, k, axis] = filtered
            channels[2, k, axis] = command
            channels[3, k, axis] = (
                state[axis, at.POSITION] + row[at.TABLE_SHARE] * state[axis, at.DEFLECTION]
            )
            channels[4, k, axis] = state[axis, at.PLAYED]
            channels[5, k, axis] = state[axis, at.RISE]
        if k + 1 < count:
            advance(arrays, state, force, k, external)
