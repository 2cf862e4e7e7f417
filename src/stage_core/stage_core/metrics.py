"""The figures in which every error is stated: RMS, MAE, max, σ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stage_core.errors import StageError

#: Half width of a 95 % interval in standard deviations.
SIGMAS = 1.96


@dataclass(frozen=True)
class Metrics:
    """RMS, mean absolute error, largest absolute error and standard deviation (k = 1)."""

    rms: float
    mae: float
    max: float
    sigma: float

    @classmethod
    def of(cls, errors: ArrayLike) -> Metrics:
        """Metrics of signed errors (n,) or (n, axes), in their unit; sigma is about each mean.

        Raises
        ------
        StageError
            Without an error, or with one that is not a number.
        """
        e = np.asarray(errors, dtype=float)
        if e.size == 0:
            raise StageError('there is no error to state: nothing was measured')
        if not np.isfinite(e).all():
            raise StageError('an error is not a number: look for NaN in what was measured')
        return cls(
            rms=float(np.sqrt(np.mean(e**2))),
            mae=float(np.abs(e).mean()),
            max=float(np.abs(e).max()),
            sigma=float(np.sqrt(e.var(axis=0).mean())),
        )
