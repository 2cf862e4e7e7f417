"""Exact discretisation of the linear plant: masses, viscous friction, and the spring between."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import expm

from stage_twin import hooks
from stage_twin import layout as at

#: Longest substep while friction or a force over position is on [s].
LONGEST_SUBSTEP = 2.5e-4
# Four states and the held force.
_AUGMENTED = 5


def discretise(
    axes: np.ndarray, period: float, transitions: np.ndarray, schedule: np.ndarray
) -> None:
    """Exact transitions of the linear plant over one substep of each piece of a tick.

    Parameters
    ----------
    axes : (n_axes, AXIS_WIDTH)
    period : float
        Tick [s].
    transitions : (n_axes, PIECES, DIRECTIONS, MOTION, MOTION + 1), written
        The last column is the gain of the held force.
    schedule : (n_axes, SCHEDULE_WIDTH), written
        Whole ticks of delay, stiffness of the bristles [N/m], speed below which they give way
        [m/s], then per piece the number of substeps and the length of one [s].
    """
    for axis in range(axes.shape[0]):
        row = axes[axis]
        delay = row[at.DELAY]
        ticks = math.floor(delay / period + 1e-9)
        fraction = max(0.0, delay - ticks * period)
        if fraction < 1e-9 * period:
            fraction = 0.0
        stiffness = hooks.stiffness(row)
        divided = (
            stiffness > 0.0
            or row[at.FINE_COLUMN] != 0.0
            or row[at.VISCOUS_POSITIVE] != row[at.VISCOUS_NEGATIVE]
        )
        schedule[axis, at.DELAY_TICKS] = ticks
        schedule[axis, at.BRISTLES] = stiffness
        schedule[axis, at.CREEP] = hooks.creep(row)
        for piece in range(at.PIECES):
            length = fraction if piece == 0 else period - fraction
            count = 0
            if length > 0.0:
                count = max(1, math.ceil(length / LONGEST_SUBSTEP - 1e-9)) if divided else 1
            step = length / count if count > 0 else 0.0
            schedule[axis, at.FIRST_PIECE + 2 * piece] = count
            schedule[axis, at.FIRST_PIECE + 2 * piece + 1] = step
            for direction in range(at.DIRECTIONS):
                _transition(row, direction, step, transitions[axis, piece, direction])


def _transition(row: np.ndarray, direction: int, step: float, out: np.ndarray) -> None:
    one_sided = row[at.VISCOUS_POSITIVE] if direction == 1 else row[at.VISCOUS_NEGATIVE]
    viscous = row[at.VISCOUS] + one_sided
    carried = row[at.CARRIED]
    stiffness = carried * row[at.NATURAL] ** 2
    damping = 2.0 * row[at.DAMPING] * carried * row[at.NATURAL]
    motor = row[at.MASS] - carried
    system = np.zeros((_AUGMENTED, _AUGMENTED))
    system[0, 1] = 1.0
    system[1, 1] = -viscous / motor
    system[1, 2] = stiffness / motor
    system[1, 3] = damping / motor
    system[1, 4] = 1.0 / motor
    if row[at.NATURAL] > 0.0:
        # Deflection = carried mass - motor; its acceleration is the difference of both. A load
        # without mass to speak of swings and leaves the motor alone.
        system[2, 3] = 1.0
        system[3, 1] = viscous / motor
        system[3, 2] = -(row[at.NATURAL] ** 2) - stiffness / motor
        system[3, 3] = -2.0 * row[at.DAMPING] * row[at.NATURAL] - damping / motor
        system[3, 4] = -1.0 / motor
    out[:, :] = expm(system * step)[: at.MOTION, :]
