"""Where the stage goes in a session: alignment, calibration grid, held-out points."""

from __future__ import annotations

import numpy as np

from stage_core.arrays import Array


def alignment_points(half_range: float) -> Array:
    """Positions for the tracker's alignment: corners and centre of the workspace, (6, 2) [m]."""
    h = 0.8 * half_range
    return np.array([[-h, -h], [h, -h], [h, h], [-h, h], [0.0, 0.0], [0.5 * h, -0.5 * h]])


def calibration_grid(half_range: float, points: int) -> Array:
    """A grid visited row by row and back, (2 · points², 2) [m].

    Every position is approached from both sides in both axes, so that reversal errors show:
    rows are run to and fro on the way up, columns on the way down.
    """
    axis = np.linspace(-half_range, half_range, points)
    up = [(x, y) for row, y in enumerate(axis) for x in (axis if row % 2 == 0 else axis[::-1])]
    down = [
        (x, y)
        for column, x in enumerate(axis[::-1])
        for y in (axis[::-1] if column % 2 == 0 else axis)
    ]
    # Rows and columns that follow the lead exactly would never see its cyclic error: each point
    # is moved by a low-discrepancy fraction of the grid's step, the same on every run.
    visited = np.array(up + down)
    step = axis[1] - axis[0] if points > 1 else half_range
    k = np.arange(len(visited))[:, None] + 1
    fraction = (k * np.array([0.7548776662466927, 0.5698402909980532])) % 1.0 - 0.5
    return np.clip(visited + 0.5 * step * fraction, -half_range, half_range)


def heldout_points(half_range: float, count: int, seed: int) -> Array:
    """Random positions that no model is trained on, (count, 2) [m]."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.95 * half_range, 0.95 * half_range, (count, 2))


def positioning_points(half_range: float, axis: int, targets: int = 5, cycles: int = 5) -> Array:
    """Positions of a test by ISO 230-2 of one axis (0 or 1), (cycles · 2 · (targets + 1), 2) [m].

    Each cycle visits the targets upwards, turns beyond the last one, and visits them downwards.
    The targets are not equidistant, as the standard asks, so that a periodic error shows.
    """
    places = np.linspace(-0.85, 0.85, targets)
    places += 0.1 * ((np.arange(targets) * 0.6180339887498949) % 1.0 - 0.5)
    cycle = np.concatenate([[-1.0], places, [1.0], places[::-1]])
    points = np.zeros((cycles * len(cycle), 2))
    points[:, axis] = np.tile(half_range * cycle, cycles)
    return points
