"""The command that reaches a wanted table point."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stage_core.arrays import Array

STEP = 1e-7
"""Step of the finite differences [m]."""
TOLERANCE = 1e-9
"""Largest distance [m] from the wanted point that ends the search."""
ITERATIONS = 60


def invert(error: Callable[[Array], Array], wanted: Array, smooth: bool) -> tuple[Array, Array]:
    """Commands (n, axes) [m] with command + error(command) = wanted, and what is left, (n,) [m].

    Fixed point c <- c + (wanted - c - error(c)), which contracts because a stage's error changes
    by far less than a metre per metre; smooth errors that do not settle are finished by Newton's
    method with a finite-difference Jacobian. The best iterate of each point is returned.
    """
    command, best = wanted.copy(), wanted.copy()
    least = np.full(len(wanted), np.inf)
    for iteration in range(ITERATIONS):
        gap = wanted - (command + error(command))
        residual = np.max(np.abs(gap), axis=1)
        better = residual < least
        best[better], least[better] = command[better], residual[better]
        if (least <= TOLERANCE).all():
            break
        if iteration < ITERATIONS // 2 or not smooth:
            command = command + gap
        else:
            command = best + _newton_step(error, best, wanted)
    return best, least


def _newton_step(error: Callable[[Array], Array], command: Array, wanted: Array) -> Array:
    axes = command.shape[1]
    base = command + error(command)
    jacobian = np.empty((len(command), axes, axes))
    for axis in range(axes):
        moved = command.copy()
        moved[:, axis] += STEP
        jacobian[:, :, axis] = (moved + error(moved) - base) / STEP
    # A singular Jacobian must not end the loop: other points can still converge.
    flat = np.abs(np.linalg.det(jacobian)) < 1e-6
    jacobian[flat] = np.eye(axes)
    return np.asarray(np.linalg.solve(jacobian, (wanted - base)[:, :, None])[:, :, 0], float)
