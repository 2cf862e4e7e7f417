"""The figures of a run: RMS, mean absolute and largest errors (eqs. 13, 31, 32 of paper 3)."""

from __future__ import annotations

from dataclasses import dataclass

from stage_core.arrays import Array
from stage_core.metrics import Metrics


@dataclass(frozen=True)
class Figures:
    """Errors of one run [m]: tracking of each axis, contour. The AIAE of eq. 31 is `mae`."""

    x: Metrics
    y: Metrics
    contour: Metrics

    def sentence(self) -> str:
        """One line in micrometres."""
        return (
            f'tracking RMS x {1e6 * self.x.rms:.2f} y {1e6 * self.y.rms:.2f} µm, '
            f'max x {1e6 * self.x.max:.1f} y {1e6 * self.y.max:.1f} µm, '
            f'contour RMS {1e6 * self.contour.rms:.2f} µm, max {1e6 * self.contour.max:.1f} µm'
        )


def figures(tracking: Array, contour: Array) -> Figures:
    """Eqs. 13, 31 and 32 of tracking errors (n, 2) and contour errors (n,) [m]."""
    return Figures(Metrics.of(tracking[:, 0]), Metrics.of(tracking[:, 1]), Metrics.of(contour))
