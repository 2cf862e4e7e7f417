"""The figures of a run: RMS, mean absolute and largest errors (eqs. 13, 31, 32 of paper 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Figures:
    """Errors of one run [m]: tracking per axis (2,), contour; RMS, AIAE (eq. 31), maximum."""

    tracking_rms: FloatArray
    tracking_aiae: FloatArray
    tracking_max: FloatArray
    contour_rms: float
    contour_aiae: float
    contour_max: float

    def sentence(self) -> str:
        """One line in micrometres."""
        rms, largest = 1e6 * self.tracking_rms, 1e6 * self.tracking_max
        return (
            f'tracking RMS x {rms[0]:.2f} y {rms[1]:.2f} µm, max x {largest[0]:.1f} '
            f'y {largest[1]:.1f} µm, contour RMS {1e6 * self.contour_rms:.2f} µm, '
            f'max {1e6 * self.contour_max:.1f} µm'
        )


def figures(tracking: FloatArray, contour: FloatArray) -> Figures:
    """Eqs. 13, 31 and 32 of tracking errors (n, 2) and contour errors (n,) [m]."""
    return Figures(
        np.sqrt(np.mean(tracking**2, axis=0)),
        np.mean(np.abs(tracking), axis=0),
        np.max(np.abs(tracking), axis=0),
        float(np.sqrt(np.mean(contour**2))),
        float(np.mean(np.abs(contour))),
        float(np.max(np.abs(contour))),
    )
