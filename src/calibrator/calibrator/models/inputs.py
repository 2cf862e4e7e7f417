"""What every method takes, checked: points, directions and temperatures."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from stage_core.arrays import Array
from stage_core.errors import StageError


def checked(
    command: ArrayLike,
    direction: ArrayLike | None,
    temperatures: ArrayLike | None,
    usual: Array,
) -> tuple[Array, Array, Array]:
    """Commands, directions and temperatures as arrays; `usual` (sensors,) where none are given.

    Raises
    ------
    StageError
        For shapes that do not agree, or a value that is not finite.
    """
    c = np.asarray(command, dtype=float)
    if c.ndim != 2 or c.shape[1] < 1 or len(c) == 0:
        raise StageError(f'points must have shape (n, axes), got {c.shape}')
    require_finite(c, 'points')
    d = np.zeros_like(c) if direction is None else np.asarray(direction, dtype=float)
    if d.shape != c.shape:
        raise StageError(f'directions have shape {d.shape}, the points {c.shape}')
    require_finite(d, 'directions')
    if temperatures is None:
        return c, d, np.tile(usual, (len(c), 1))
    t = np.asarray(temperatures, dtype=float)
    if t.ndim != 2 or len(t) != len(c):
        raise StageError(
            f'temperatures have shape {t.shape}: give one row per point, (n, sensors)'
        )
    for sensor in range(t.shape[1]):
        bad = int(np.count_nonzero(~np.isfinite(t[:, sensor])))
        if bad:
            raise StageError(
                f'temperature sensor {sensor} dropped out in {bad} of {len(t)} samples: '
                'repair it or train without temperatures'
            )
    return c, d, t


def require_finite(values: Array, what: str) -> None:
    """Raise a StageError where a row (n, columns) is not finite."""
    bad = int(np.count_nonzero(~np.isfinite(values).all(axis=-1)))
    if bad:
        raise StageError(
            f'{bad} of {len(values)} {what} are not finite: remove them or record again'
        )


def scaling_of(values: Array) -> tuple[Array, Array]:
    """Centre and half range per column, so that (values - centre)/half lies in [-1, 1]."""
    low, high = values.min(axis=0), values.max(axis=0)
    half = (high - low) / 2.0
    return (high + low) / 2.0, np.where(half > 0.0, half, 1.0)
