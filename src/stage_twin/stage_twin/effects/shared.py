"""What several effects have alike: parameters, the angle of a screw, a filter."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.polynomial.legendre import legval

from stage_core.arrays import Array
from stage_twin.effects.definition import Parameter

PERIOD = Parameter(
    'period',
    'm',
    0.0,
    20.0,
    0.0,
    'spatial period; 0 takes the lead',
    fitted=False,
    neutral=None,
    scanned=True,
)
PHASE = Parameter(
    'phase', 'rad', -6.2831854, 6.2831854, 0.0, 'phase at position 0', nuisance=True, neutral=None
)
CENTRE = Parameter(
    'centre', 'm', -20.0, 20.0, 0.0, 'middle of the travel', fitted=False, neutral=None
)
HALF_RANGE = Parameter(
    'half_range',
    'm',
    1e-3,
    20.0,
    0.05,
    'half of the travel over which it is given',
    fitted=False,
    neutral=None,
)

#: Highest order of a curve of the travel: six waves and a half over the travel need 25.
ORDERS = 25
#: What its mean square curvature counts beside the mean square of what it leaves. Of two guides
#: that are splines, 1e-7 to 1e-5 predict other rows better than any curve of fewer orders.
ROUGH = 1e-6
#: Spatial periods below this [m] stand for the lead.
SHORTEST_LENGTH = 1e-9


def roughness(lowest: int, highest: int) -> Array:
    """What the squares of the factors (k,) of Legendre polynomials count, see `Term.roughness`.

    `ROUGH` times the integral of the square of d/ds (1 - s²) df/ds, which makes k (k + 1) Pk of Pk
    (smoothing splines: Wahba, SIAM J. Sci. Stat. Comput. 2, 1981).
    """
    k = np.arange(lowest, highest + 1)
    return np.asarray(ROUGH * (k * (k + 1.0)) ** 2 / (2.0 * k + 1.0))


#: Range of a curve over the travel in that at the places that were visited: 1.00 in 35 sessions
#: with such a curve, 1.12 and 722 in two without one.
BEYOND = 1.05


def within_seen(curve: Array, places: Array) -> bool:
    """Whether a sum of Legendre polynomials goes no further than where it was seen.

    Parameters
    ----------
    curve : factors of P0, P1 and so on (k,)
    places : visited ones (n,), -1 to 1 over the travel; a curve in between is the fit's invention
    """
    visited = np.unique(np.round(places, 2))
    whole = np.linspace(-1.0, 1.0, 201)
    return bool(np.ptp(legval(whole, curve)) <= BEYOND * np.ptp(legval(visited, curve)))


@njit
def screw_angle(position: float, period: float, lead: float) -> float:
    """Angle [rad] of what repeats over `period`, or over the lead where that is 0."""
    return 2.0 * math.pi * position / (period if period > SHORTEST_LENGTH else lead)


def filtered(
    b: list[float], a: list[float], signal: Array, initial: list[float] | None = None
) -> Array:
    """A signal behind the filter b / a, from rest or from an initial state."""
    # Only here: scipy.signal takes half a second to import, and the emulated machine needs none.
    from scipy.signal import lfilter

    out = lfilter(b, a, signal, zi=initial)
    return np.asarray(out if initial is None else out[0])
