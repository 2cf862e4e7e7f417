"""95 % intervals of the figures that pages state."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from stage_core.errors import StageError

Array = NDArray[np.float64]


def distance_rms(errors: ArrayLike) -> float:
    """RMS of the distances |e_i| of errors (n, axes), in their unit."""
    e = np.asarray(errors, dtype=float)
    return float(np.sqrt((e**2).sum(axis=-1).mean()))


def rms_interval(errors: ArrayLike) -> tuple[float, float]:
    """95 % interval of `distance_rms` for independent normal errors about zero.

    The mean square is taken as chi-squared with the degrees of freedom of Satterthwaite
    (Biometrics Bulletin 2, 1946), since the axes differ: f = n (Σ s_a²)² / Σ s_a⁴.

    Parameters
    ----------
    errors : (n, axes), n positions.

    Raises
    ------
    StageError
        With fewer than two positions.
    """
    e = np.asarray(errors, dtype=float)
    if e.ndim != 2 or len(e) < 2:
        raise StageError('an interval needs errors at two positions or more: measure more')
    squares = (e**2).mean(axis=0)
    total = float(squares.sum())
    if total == 0.0:
        return 0.0, 0.0
    freedom = len(e) * total**2 / float((squares**2).sum())
    low, high = chi2.ppf([0.975, 0.025], freedom)
    return float(np.sqrt(total * freedom / low)), float(np.sqrt(total * freedom / high))
