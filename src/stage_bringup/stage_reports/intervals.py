"""95 % intervals of the figures that pages state."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2

from stage_core.errors import StageError

#: Stretches that a path is resampled in, and how often.
STRETCHES = 24
DRAWS = 2000


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


def path_interval(errors: ArrayLike) -> tuple[float, float]:
    """95 % interval of the RMS of errors (n,) or (n, axes) along a path, in their unit.

    A circular block bootstrap: the path is put together anew from stretches of a 24th of its
    length that begin anywhere, so errors close to each other stay together. The interval says how
    far the RMS depends on which stretches the path has. It does not say how well a run repeats.
    """
    e = np.asarray(errors, dtype=float)
    squares = e**2 if e.ndim == 1 else (e**2).sum(axis=1)
    n = len(squares)
    length = -(-n // STRETCHES)
    total = np.concatenate([[0.0], np.cumsum(np.concatenate([squares, squares]))])
    stretches = (total[length : length + n] - total[:n]) / length
    drawn = np.random.default_rng(0).integers(0, n, (DRAWS, STRETCHES))
    low, high = np.quantile(stretches[drawn].mean(axis=1), (0.025, 0.975))
    return float(np.sqrt(low)), float(np.sqrt(high))
