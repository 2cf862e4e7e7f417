"""Expanded uncertainty of the figures of ISO 230-2 from the scatter of the sensor."""

from __future__ import annotations

import numpy as np

from stage_reports.extract import PositioningRuns
from stage_reports.iso230 import positioning

#: The standard deviation of so many draws is known to 4 %.
DRAWS = 400


def positioning_uncertainty(test: PositioningRuns, seed: int = 0) -> dict[str, float]:
    """Expanded uncertainty U (k = 2) of each scalar figure of `iso230.positioning`, m.

    The mean of each rest is drawn anew with the standard uncertainty that the scatter of the
    sensor gives it (JCGM 101:2008, propagation of distributions), and the test is evaluated again.
    Alignment, scale of the sensor and temperature are not in it.
    """
    rng = np.random.default_rng(seed)
    drawn: dict[str, list[float]] = {}
    for _ in range(DRAWS):
        up = test.up + test.noise * rng.standard_normal(test.up.shape)
        down = test.down + test.noise * rng.standard_normal(test.down.shape)
        for name, value in vars(positioning(test.targets, up, down)).items():
            if isinstance(value, float):
                drawn.setdefault(name, []).append(value)
    return {name: 2.0 * float(np.std(values, ddof=1)) for name, values in drawn.items()}
