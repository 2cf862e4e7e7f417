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


@compiled
def run_session(
    axes: np.ndarray,
    transitions: np.ndarray,
    schedule: np.ndarray,
    period: float,
    start: np.ndarray,
    reference: np.ndarray,
    reference_velocity: np.ndarray,
    compensation: np.ndarray,
    force: np.ndarray,
    open_loop: bool,
    external: np.ndarray,
    channels: np.ndarray,
) -> None:
    """Simulate a session from rest.

    Parameters
    ----------
    reference, reference_velocity, compensation, external : (n, n_axes)
    force : (n_axes, n)
        Force commands: written by the controller, or its input where `open_loop`.
    channels : (6, n, n_axes), written
        Encoder q, filtered velocity vf, velocity command vc, motor (table-side) position,
        that position behind the play, rise of the screw's temperature [K].
    """
    count = reference.shape[0]
    width = axes.shape[0]
    state = np.zeros((width, at.STATE_WIDTH))
    controller = np.zeros((width, at.CONTROLLER_WIDTH))
    encoders = np.zeros(width)
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
            if not open_loop:
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
            advance(axes, transitions, schedule, state, force, k, external[k])
