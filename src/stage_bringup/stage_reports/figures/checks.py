"""Check of arrays that pictures take."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from stage_core.arrays import Array
from stage_core.errors import StageError


def pairs(name: str, values: ArrayLike) -> Array:
    """Points (n, 2) in metres.

    Raises
    ------
    StageError
        For another shape or a value that is not finite.
    """
    table = np.asarray(values, dtype=float)
    if table.ndim != 2 or table.shape[1] != 2 or not np.isfinite(table).all():
        raise StageError(f'{name} of shape {table.shape}: give finite numbers (n, 2) in metres')
    return table
