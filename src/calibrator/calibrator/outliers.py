"""Wild samples among good ones: a beam that came back elsewhere, a reflector that was touched."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stage_core.arrays import Array

WILD = 10.0
"""Deviations beyond which a sample is wild; ten times those that half of the samples keep."""
MOST_WILD = 0.05
"""A larger share is no outlier but how the stage is: nothing is left out then."""
PASSES = 20


def wild(command: Array, error: Array) -> NDArray[np.bool_]:
    """Mask (n,) of the samples whose error (n, axes) [m] no smooth map of the stage explains.

    Judged beside an affine map of the least absolute deviations, which outliers do not bend; the
    deviation is 1.4826 times the median absolute one.
    """
    half = np.maximum(np.ptp(command, axis=0) / 2.0, 1e-300)
    design = np.column_stack([np.ones(len(command)), (command - command.mean(axis=0)) / half])
    found = np.zeros(len(command), dtype=bool)
    for target in error.T:
        rest = target - np.median(target)
        for _ in range(PASSES):
            root = 1.0 / np.sqrt(np.maximum(np.abs(rest), 1e-9 * np.abs(rest).max() + 1e-300))
            weights = np.linalg.lstsq(design * root[:, None], target * root, rcond=None)[0]
            rest = target - design @ weights
        deviation = 1.4826 * float(np.median(np.abs(rest)))
        if deviation > 0.0:
            found |= np.abs(rest) > WILD * deviation
    return found if found.mean() <= MOST_WILD else np.zeros(len(command), dtype=bool)
