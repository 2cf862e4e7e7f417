"""Candidate terms of the thermal calibration (paper 2), for any number of axes and sensors.

For q axes and s sensors: all monomials of the coordinates of order one to three, each of them
times each temperature, and per sensor the temperature and its first and second derivative. Three
axes and nine sensors give 19 + 171 + 9 + 18 = 217 terms.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np

from stage_core.arrays import Array
from stage_core.errors import StageError

SETS = ('geometric', 'thermal', 'correlated', 'derivatives')
"""Groups of terms in the order of the paper's section V.B; each set holds those before it."""


def monomials(axes: int, order: int = 3) -> list[tuple[int, ...]]:
    """Exponent per axis of all monomials of order 1 to `order`: 19 for three axes."""
    result = []
    for total in range(1, order + 1):
        for chosen in combinations_with_replacement(range(axes), total):
            result.append(tuple(chosen.count(axis) for axis in range(axes)))
    return result


def thermal_terms(
    coordinates: Array,
    temperatures: Array,
    first: Array | None = None,
    second: Array | None = None,
    reference: Array | None = None,
) -> dict[str, Array]:
    """The candidate terms of samples: the columns (m, n) of each group of `SETS`.

    Parameters
    ----------
    coordinates
        (m, axes), any unit; scaled ones keep products readable.
    temperatures, first, second
        (m, sensors) [degC], their derivatives [K/s] and [K/s2]; without derivatives their terms
        are left out.
    reference
        Temperatures (sensors,) that are subtracted; a product with raw degC is collinear with its
        coordinate. Zero where not given.
    """
    q = np.asarray(coordinates, dtype=float)
    t = np.asarray(temperatures, dtype=float)
    if reference is not None:
        t = t - reference
    geometric = np.column_stack([np.prod(q ** np.array(p), axis=1) for p in monomials(q.shape[1])])
    none = np.empty((len(q), 0))
    correlated = [geometric * t[:, s : s + 1] for s in range(t.shape[1])]
    derivatives = [d for d in (first, second) if d is not None]
    return {
        'geometric': geometric,
        'thermal': t,
        'correlated': np.column_stack([none, *correlated]),
        'derivatives': np.column_stack([none, *derivatives]),
    }


def up_to(terms: dict[str, Array], group: str) -> Array:
    """The columns of the groups up to and including one."""
    if group not in SETS:
        raise StageError(f'there is no set of terms {group}: choose one of {", ".join(SETS)}')
    return np.column_stack([terms[name] for name in SETS[: SETS.index(group) + 1]])


DERIVATIVE_SPAN = 300.0
"""Seconds of readings that a derivative is taken from: a millikelvin of noise at every second
then leaves 1e-6 K/s, where a room drifts by 5e-5 K/s."""
FEWEST_READINGS = 8


def derivatives_at(
    times: Array, values: Array, at: Array, span: float = DERIVATIVE_SPAN
) -> tuple[Array, Array]:
    """First [K/s] and second [K/s2] derivative of one sensor at the times `at` [s], (n,) each.

    A parabola by least squares through the readings of the last `span` seconds, which is also what
    a running controller knows; plain differences of a sensor with 1 mK noise at 10 s are ten times
    the drift itself. Times before the first full span take the parabola of that one.

    Raises
    ------
    StageError
        If the readings do not cover the span, or are too few in one.
    """
    if len(times) < FEWEST_READINGS or times[-1] - times[0] < span:
        raise StageError(
            f'temperatures over {float(np.ptp(times)) if len(times) else 0.0:.0f} s are too few '
            f'for derivatives over {span:.0f} s: record longer or set the option derivatives to '
            'false'
        )
    ends = np.maximum(at, times[0] + span)
    result = np.empty((2, len(ends)))
    for k, end in enumerate(ends):
        first, last = np.searchsorted(times, [end - span, end], side='right')
        first = max(first - 1, 0)
        if last - first < FEWEST_READINGS:
            raise StageError(
                f'only {last - first} temperatures in {span:.0f} s are too few for derivatives: '
                'repair the sensor or set the option derivatives to false'
            )
        u = (times[first:last] - end) / span
        c = np.linalg.lstsq(np.vander(u, 3), values[first:last], rcond=None)[0]
        result[:, k] = c[1] / span, 2.0 * c[0] / span**2
    return result[0], result[1]
