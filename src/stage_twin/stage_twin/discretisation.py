"""Exact discretisation of the linear plant: masses, viscous friction, and the spring between."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stage_twin import layout as at

#: Longest substep while friction or a force over position is on [s].
LONGEST_SUBSTEP = 2.5e-4
# Four states and the held force.
_AUGMENTED = 5


@njit(cache=True)
def _exponential(matrix: np.ndarray) -> np.ndarray:
    """exp of a small matrix by scaling, Taylor series and squaring."""
    size = matrix.shape[0]
    norm = np.abs(matrix).sum(axis=1).max()
    halvings = 0
    while norm > 0.25:
        norm *= 0.5
        halvings += 1
    scaled = matrix / 2.0**halvings
    result = np.eye(size)
    term = np.eye(size)
    for order in range(1, 14):
        term = term @ scaled / order
        result = result + term
    for _ in range(halvings):
        result = result @ result
    return result


@njit(cache=True)
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
    schedule : (n_axes, 2 + 2 * PIECES), written
        Whole ticks of delay, 1 where friction is on, then per piece the number of substeps
        and the length of one [s].
    """
    for axis in range(axes.shape[0]):
        row = axes[axis]
        delay = row[at.DELAY] + row[at.DELAY_ADDED]
        ticks = math.floor(delay / period + 1e-9)
        fraction = max(0.0, delay - ticks * period)
        if fraction < 1e-9 * period:
            fraction = 0.0
        rough = (
            row[at.COULOMB] > 0.0
            or row[at.ASYMMETRIC_POSITIVE] > 0.0
            or row[at.ASYMMETRIC_NEGATIVE] > 0.0
            or row[at.STRIBECK_COULOMB] > 0.0
            or row[at.STRIBECK_BREAKAWAY] > 0.0
        )
        divided = (
            rough
            or row[at.RIPPLE_AMPLITUDE] != 0.0
            or row[at.CABLE_STIFFNESS] != 0.0
            or row[at.CABLE_HARDENING] != 0.0
            or row[at.VISCOUS_POSITIVE] != row[at.VISCOUS_NEGATIVE]
        )
        schedule[axis, 0] = ticks
        schedule[axis, 1] = 1.0 if rough else 0.0
        for piece in range(at.PIECES):
            length = fraction if piece == 0 else period - fraction
            count = 0
            if length > 0.0:
                count = max(1, math.ceil(length / LONGEST_SUBSTEP - 1e-9)) if divided else 1
            step = length / count if count > 0 else 0.0
            schedule[axis, 2 + 2 * piece] = count
            schedule[axis, 3 + 2 * piece] = step
            for direction in range(at.DIRECTIONS):
                _transition(row, direction, step, transitions[axis, piece, direction])


@njit(cache=True)
def _transition(row: np.ndarray, direction: int, step: float, out: np.ndarray) -> None:
    mass = row[at.MASS] * (1.0 + row[at.INERTIA_RATIO])
    one_sided = row[at.VISCOUS_POSITIVE] if direction == 1 else row[at.VISCOUS_NEGATIVE]
    viscous = row[at.VISCOUS] + row[at.VISCOUS_ADDED] + one_sided
    carried = 0.0
    stiffness = 0.0
    damping = 0.0
    if row[at.RESONANCE_FREQUENCY] > 0.0 and row[at.RESONANCE_RATIO] > 0.0:
        natural = 2.0 * math.pi * row[at.RESONANCE_FREQUENCY]
        carried = mass * row[at.RESONANCE_RATIO]
        stiffness = carried * natural**2
        damping = 2.0 * row[at.RESONANCE_DAMPING] * carried * natural
    motor = mass - carried
    system = np.zeros((_AUGMENTED, _AUGMENTED))
    system[0, 1] = 1.0
    system[1, 1] = -viscous / motor
    system[1, 2] = stiffness / motor
    system[1, 3] = damping / motor
    system[1, 4] = 1.0 / motor
    if carried > 0.0:
        # Deflection = carried mass - motor; its acceleration is the difference of both.
        system[2, 3] = 1.0
        system[3, 1] = viscous / motor
        system[3, 2] = -stiffness / carried - stiffness / motor
        system[3, 3] = -damping / carried - damping / motor
        system[3, 4] = -1.0 / motor
    out[:, :] = _exponential(system * step)[: at.MOTION, :]
