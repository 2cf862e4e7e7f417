"""The figures in which every error is stated: RMS, MAE, max, σ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stage_core.errors import StageError


@dataclass(frozen=True)
class ErrorFigures:
    """RMS, mean absolute error, largest absolute error and standard deviation (k = 1)."""

    rms: float
    mae: float
    maximum: float
    sigma: float
    count: int


def error_figures(errors: ArrayLike) -> ErrorFigures:
    """Figures of signed errors (n,), in their unit.

    Raises
    ------
    StageError
        Without an error, or with one that is not a number.
    """
    e = np.asarray(errors, dtype=float).ravel()
    if e.size == 0:
        raise StageError('there is no error to state: nothing was measured')
    if not np.isfinite(e).all():
        raise StageError('an error is not a number: look for NaN in what was measured')
    magnitude = np.abs(e)
    return ErrorFigures(
        rms=float(np.sqrt(np.mean(e**2))),
        mae=float(magnitude.mean()),
        maximum=float(magnitude.max()),
        sigma=float(e.std()),
        count=int(e.size),
    )
