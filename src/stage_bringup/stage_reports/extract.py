"""Finds the standard tests in a session: targets approached from both sides, and circles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.rests import REFERENCE_BAND, find_rests
from stage_reports.iso230 import least_squares_circle

#: Two targets closer than this (m) are the same one.
SAME_TARGET = 1e-7


@dataclass(frozen=True)
class PositioningRuns:
    """Deviations for ISO 230-2: targets (m,), up and down (m, n), metres.

    `noise` is the standard uncertainty of one deviation (m) from the scatter of the sensor.
    """

    targets: Array
    up: Array
    down: Array
    noise: float = 0.0


def positioning_runs(
    seconds: ArrayLike,
    reference: ArrayLike,
    measured: ArrayLike,
    shortest: float = 0.2,
) -> PositioningRuns | None:
    """Deviations at the targets of one axis that were approached twice from either side.

    Parameters
    ----------
    seconds, reference, measured : (n,) s, m, m of one axis; NaN in ``measured`` is left out.
    shortest : rest that counts, s. The second half of it is averaged, after the settling.

    Returns
    -------
    None where fewer than two targets qualify. All keep the same number of approaches, that of
    the target with the fewest.
    """
    actual = np.asarray(measured, dtype=float)
    commanded = np.asarray(reference, dtype=float)
    found: dict[int, tuple[list[float], list[float]]] = {}
    previous: float | None = None
    variances: list[float] = []
    for start, stop in find_rests(np.asarray(seconds, dtype=float), commanded[:, None], shortest):
        target = float(commanded[start])
        if previous is None or abs(target - previous) > SAME_TARGET:
            values = actual[(start + stop) // 2 : stop]
            values = values[np.isfinite(values)]
            if previous is not None and values.size:
                approaches = found.setdefault(round(target / SAME_TARGET), ([], []))
                approaches[0 if target > previous else 1].append(float(values.mean() - target))
                if values.size > 1:
                    variances.append(float(values.var(ddof=1)) / values.size)
            previous = target
    usable = {key: sides for key, sides in found.items() if min(len(sides[0]), len(sides[1])) >= 2}
    if len(usable) < 2:
        return None
    count_up = min(len(sides[0]) for sides in usable.values())
    count_down = min(len(sides[1]) for sides in usable.values())
    keys = sorted(usable)
    return PositioningRuns(
        np.array(keys) * SAME_TARGET,
        np.array([usable[key][0][:count_up] for key in keys]),
        np.array([usable[key][1][:count_down] for key in keys]),
        float(np.sqrt(np.mean(variances))) if variances else 0.0,
    )


@dataclass(frozen=True)
class CircularPaths:
    """Measured points of a circular test by direction; a direction not run is None."""

    radius: float
    centre: Array
    counter_clockwise: Array | None
    clockwise: Array | None


def circular_paths(
    reference: ArrayLike, measured: ArrayLike, roundness: float = 1e-3
) -> CircularPaths | None:
    """Split a session on a circle into its two directions.

    Parameters
    ----------
    reference, measured : (n, 2) m at the same instants.
    roundness : share of the radius by which the moving reference may leave a circle.

    Returns
    -------
    None where the reference is not a circle or covers less than a full turn either way.
    """
    commanded = np.asarray(reference, dtype=float)
    actual = np.asarray(measured, dtype=float)
    steps = np.linalg.norm(np.diff(commanded, axis=0), axis=1)
    moving = np.concatenate(([False], steps > REFERENCE_BAND))
    if moving.sum() < 16:
        return None
    try:
        centre, radius = least_squares_circle(commanded[moving])
    except StageError:
        return None
    offset = commanded - centre
    away = np.abs(np.linalg.norm(offset, axis=1) - radius)
    if away[moving].max() > roundness * radius:
        return None
    turned = np.diff(np.unwrap(np.arctan2(offset[:, 1], offset[:, 0])), prepend=np.nan)
    directions = []
    for sense in (1.0, -1.0):
        chosen = moving & (sense * turned > 0.0)
        whole = float(np.abs(turned[chosen]).sum()) >= 2.0 * np.pi * 0.98
        points = actual[chosen & np.isfinite(actual).all(axis=1)]
        directions.append(points if whole and len(points) >= 8 else None)
    if directions[0] is None and directions[1] is None:
        return None
    return CircularPaths(radius, centre, directions[0], directions[1])
