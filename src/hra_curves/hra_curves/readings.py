"""Other readings of Table 3 of paper 4, tried where the first one misses a printed digit."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from hra_curves.bases import Basis, Trigonometric
from hra_curves.cycloid import cycloid, error_at_equal_parameter, error_to_the_curve
from hra_curves.printing import Entry
from hra_curves.tables import BASIS_1, MICRO, TABLE_3, TURN, differs, hra_cycloid
from stage_core.arrays import Array


def polyline_errors(count: int, interval: int) -> dict[str, float]:
    """Largest distances (m) of one piece of the polyline to the cycloid, measured in other ways.

    Parameters
    ----------
    count : number of data, 2 pi k/n with both ends. interval : piece of the polyline, from 0.
    """
    step = TURN / (count - 1)
    share = np.linspace(0.0, 1.0, 401)
    data = cycloid(np.linspace(0.0, TURN, count))

    def piece(points: Array) -> Array:
        return points[interval] + share[:, None] * (points[interval + 1] - points[interval])

    chord, curve = piece(data), cycloid((interval + share) * step)
    vertical = np.interp(curve[:, 0], chord[:, 0], chord[:, 1]) - curve[:, 1]
    horizontal = np.interp(curve[:, 1], chord[:, 1], chord[:, 0]) - curve[:, 0]
    samples = cKDTree(cycloid(np.linspace(0.0, TURN, 501)))
    return {
        'nearest point': error_to_the_curve(chord),
        'equal parameter': float(np.linalg.norm(chord - curve, axis=1).max()),
        'along y': float(np.abs(vertical).max()),
        'along x': float(np.abs(horizontal).max()),
        'nearest of 501 samples': float(samples.query(chord)[0].max()),
        'data rounded to 1 µm': error_to_the_curve(piece(np.round(data, 6))),
    }


def rounded_error(basis: Basis, count: int, interval: int, digits: int) -> float:
    """Error (m) of the interpolant as in Table 3, the data rounded to ``digits`` of a metre."""
    data = np.round(cycloid(np.linspace(0.0, TURN, count)), digits)
    curve = hra_cycloid(data, basis)
    step = TURN / (count - 1)
    return error_at_equal_parameter(curve.evaluate, interval * step, (interval + 1) * step)


def other_readings() -> list[Entry]:
    """Entries of Table 3 by other readings, and whether each gives the printed digits."""
    found: list[tuple[str, str, str, float]] = []
    for count, columns in TABLE_3.items():
        for way, error in polyline_errors(count, 1).items():
            case = f'n+1={count} interval 2'
            found.append((case, f'linear, {way}', columns[0][1], error))
    for count in (7, 9, 11):
        for interval in (0, 1):
            case = f'n+1={count} interval {interval + 1}'
            exact = rounded_error(Trigonometric(1.5707), count, interval, 15)
            found.append((case, 'IB2, Delta = 1.5707', TABLE_3[count][3][interval], exact))
            rounded = rounded_error(BASIS_1, count, interval, 8)
            found.append(
                (case, 'IB1, data rounded to 0.01 µm', TABLE_3[count][2][interval], rounded)
            )
    return [
        Entry(
            case,
            method,
            paper,
            error * MICRO,
            'µm',
            'differs' if differs(paper, error * MICRO) else 'gives it',
        )
        for case, method, paper, error in sorted(found, key=lambda row: row[1])
    ]
