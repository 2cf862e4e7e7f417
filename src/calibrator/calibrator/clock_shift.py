"""How late the tracker's stamps are: found from the motion, not assumed (paper 1, 3.3)."""

from __future__ import annotations

import numpy as np

from stage_core.arrays import Array

JUMP = 3.0
"""A reference that is faster than the stage ever moves by this factor jumps to its target."""
JUMP_SHARE = 0.2
"""Where the stage's own count is not known: a reference that steps by this share of its span."""
LARGEST_SHIFT = 0.5
"""Clock differences up to this [s] are searched."""


def estimate_shift(times: Array, command: Array, measured_times: Array, measured: Array) -> float:
    """How late the measured stamps are [s]: measured(t) belongs to command(t - shift).

    The shift with the smallest residual of an affine fit of the measured points by the command
    (eq. 24 of paper 1), searched on a grid of 10 ms in +-0.5 s and refined. Zero where the
    command never moves, because then nothing tells the time. With the reference as command the
    servo's lag is part of it: 24 ms of the nominal twin.
    """
    chosen = np.linspace(0, len(measured_times) - 1, min(len(measured_times), 3000)).astype(int)
    t, points = measured_times[chosen], measured[chosen]
    inside = (t > times[0] + LARGEST_SHIFT) & (t < times[-1] - LARGEST_SHIFT)
    if np.count_nonzero(inside) > 20:
        t, points = t[inside], points[inside]
    if len(t) < 4 or float(np.ptp(command, axis=0).max()) <= 0.0:
        return 0.0

    def residual(shift: float) -> float:
        at = interpolate(t - shift, times, command)
        design = np.column_stack([np.ones(len(at)), at - at.mean(axis=0)])
        left = points - design @ np.linalg.lstsq(design, points, rcond=None)[0]
        return float(np.sum(left**2))

    grid = np.arange(-LARGEST_SHIFT, LARGEST_SHIFT + 1e-9, 0.01)
    values = np.array([residual(s) for s in grid])
    best = int(np.argmin(values))
    if values[best] > 0.999 * values[len(grid) // 2]:
        # Nothing gained over no shift: the points were taken at rest.
        return 0.0
    # Only here: it takes a quarter of a second to import.
    from scipy.optimize import minimize_scalar

    found = minimize_scalar(
        residual, bounds=(grid[best] - 0.01, grid[best] + 0.01), method='bounded',
        options={'xatol': 1e-6},
    )  # fmt: skip
    return float(found.x)


def jumps(times: Array, command: Array, counted: tuple[Array, Array] | None) -> bool:
    """Whether the command jumps to its targets, as a stepper's does when a move is sent.

    Parameters
    ----------
    counted
        Times (m,) and positions (m, axes) of the stage's own count, in any unit, where known.
    """
    if counted is None:
        return bool(np.abs(np.diff(_in_spans(command))).max(initial=0.0) > JUMP_SHARE)
    return _fastest(times, command) > JUMP * _fastest(*counted)


def _in_spans(positions: Array) -> Array:
    """The axis that travels most, in spans of its travel, (n,); zeros where none moves."""
    span = np.ptp(positions, axis=0)
    widest = positions[:, int(np.argmax(span))]
    return widest / span.max() if span.max() > 0.0 else np.zeros(len(positions))


def _fastest(times: Array, positions: Array) -> float:
    """Largest speed of the axis that travels most, in spans per second."""
    rate = np.diff(_in_spans(positions)) / np.maximum(np.diff(times), 1e-6)
    return float(np.abs(rate).max(initial=0.0))


def interpolate(at: Array, times: Array, values: Array) -> Array:
    """Columns of `values` (n, axes) at the times `at`, linear between `times`."""
    return np.column_stack([np.interp(at, times, column) for column in values.T])
