"""The sensor link: what the tracker reports of the table's path."""

from __future__ import annotations

import numpy as np

from stage_core.twin_file import TwinFile
from stage_twin import hooks
from stage_twin.packing import KernelArrays


def sample_path(path: np.ndarray, period: float, times: np.ndarray) -> np.ndarray:
    """Table position between ticks, by cubic interpolation through four ticks.

    Parameters
    ----------
    path : (n, n_axes)
        Table position [m] at t = k * period.
    times : (m,)
        Instants [s]; outside the session the path stands still at its ends.

    Returns
    -------
    (m, n_axes) [m]
    """
    last = path.shape[0] - 1
    place = np.clip(np.asarray(times, dtype=float) / period, 0.0, last)
    # Instants on a tick, up to rounding of the division, are taken as they are.
    nearest = np.rint(place)
    place = np.where(np.abs(place - nearest) < 1e-7, nearest, place)
    lower = np.minimum(np.floor(place).astype(np.int64), max(last - 1, 0))
    u = (place - lower)[:, None]
    before = path[np.maximum(lower - 1, 0)]
    first = path[lower]
    second = path[np.minimum(lower + 1, last)]
    after = path[np.minimum(lower + 2, last)]
    return (
        first
        + 0.5 * u * (second - before)
        + u**2 * (before - 2.5 * first + 2.0 * second - 0.5 * after)
        + u**3 * (0.5 * (after - before) + 1.5 * (first - second))
    )


def to_tracker_frame(common: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Table positions (m, n_axes) as the tracker sees them, (m, 3) [m]."""
    plane = np.zeros((points.shape[0], 3))
    plane[:, : points.shape[1]] = points
    return hooks.seen(common, plane)


def measure(
    twin: TwinFile,
    arrays: KernelArrays,
    table: np.ndarray,
    stamps: np.ndarray | None,
    seed: int,
    noise: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """What the tracker reports of a table's path.

    Parameters
    ----------
    table : (n, n_axes)
        Table position [m], one row per tick.
    stamps : (m,) or None
        Stamps of the tracker's clock [s]; None: the points of the file's tracker at its rate.

    Returns
    -------
    Stamps (m,) [s] and points (m, 3) [m]; none where the twin has no tracker.
    """
    own = stamps is None
    if stamps is None:
        rate = twin.tracker.rate if twin.tracker is not None else 0.0
        duration = (table.shape[0] - 1) * arrays.period
        # A tick that is also an instant of the tracker counts, whatever its rounding.
        count = int(np.floor(duration * rate * (1.0 + 1e-12))) + 1 if rate > 0.0 else 0
        stamps = hooks.stamp(arrays.common, np.arange(count) / (rate or 1.0))
    stamps = np.asarray(stamps, dtype=float)
    seen = sample_path(table, arrays.period, hooks.true_time(arrays.common, stamps))
    points = to_tracker_frame(arrays.common, seen)
    if noise and twin.tracker is not None:
        points += twin.tracker.noise * np.random.default_rng(seed).standard_normal(points.shape)
    return (hooks.point_stamp(arrays.common, stamps) if own else stamps), points
