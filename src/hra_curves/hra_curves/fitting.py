"""Interpolation and least-squares fitting of planar curves (Section 4.3 of paper 4)."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from hra_curves.bases import Basis, Bernstein
from hra_curves.curve import HraCurve
from hra_curves.factorisation import check_nodes, factorise
from hra_curves.solvers import least_squares, solve
from stage_core.arrays import Array
from stage_core.errors import StageError

PLACEMENTS = ('closed', 'interior', 'chebyshev')


class HraWarning(UserWarning):
    """A fit that is computed well and still is not what its user wants."""


def parameter_nodes(domain: tuple[float, float], count: int, placement: str = 'closed') -> Array:
    """Nodes (count,) in an interval.

    ``closed`` divides it equally with both ends (Table 3 of paper 4), ``interior`` leaves the ends
    out, i/(count + 1) (Table 4 and Table 1), ``chebyshev`` takes the Chebyshev points.
    """
    if count < 1:
        raise StageError(f'{count} nodes asked for: give at least 1')
    if placement == 'closed':
        fractions = np.linspace(0.0, 1.0, count) if count > 1 else np.array([0.5])
    elif placement == 'interior':
        fractions = np.arange(1, count + 1) / (count + 1)
    elif placement == 'chebyshev':
        angles = (np.arange(count)[::-1] + 0.5) * (math.pi / count)
        fractions = 0.5 + 0.5 * np.cos(angles)
    else:
        raise StageError(f'no placement {placement!r}: choose one of {", ".join(PLACEMENTS)}')
    lower, upper = domain
    return lower + (upper - lower) * fractions


def chord_length_nodes(points: ArrayLike, domain: tuple[float, float]) -> Array:
    """Nodes (n,) in an interval, spaced as the points (n, d) are along their chords.

    For points that are not equally spaced on the curve; equal nodes would make it swing.

    Raises
    ------
    StageError
        Two neighbouring points coincide.
    """
    values = _check_points(points)
    steps = np.linalg.norm(np.diff(values, axis=0), axis=1)
    if values.shape[0] < 2 or (steps <= 0.0).any():
        raise StageError('chord lengths need two or more points, no two neighbours equal')
    fractions = np.concatenate(([0.0], np.cumsum(steps)))
    lower, upper = domain
    nodes = lower + (upper - lower) * (fractions / fractions[-1])
    nodes[-1] = upper
    return nodes


def _check_points(points: ArrayLike) -> Array:
    values = np.ascontiguousarray(points, dtype=float)
    if values.ndim != 2:
        raise StageError(f'points of shape {values.shape}: give a table with one row a point')
    if not np.isfinite(values).all():
        row = int(np.argwhere(~np.isfinite(values))[0][0])
        raise StageError(f'point {row} is not finite: remove it')
    return values


def _nodes(basis: Basis, nodes: ArrayLike | None, count: int) -> Array:
    if nodes is None:
        return parameter_nodes(basis.domain, count)
    values = check_nodes(basis, nodes)
    if values.size != count:
        raise StageError(f'{values.size} nodes for {count} points: give one node for each point')
    return values


def _warn_origin(basis: Basis, degree: int) -> None:
    if not basis.contains_constants(degree):
        warnings.warn(
            f'the {type(basis).__name__} basis of odd degree {degree} does not contain constants: '
            'the curve changes when the origin moves; use an odd number of control points',
            HraWarning,
            stacklevel=3,
        )


def overshoot(curve: HraCurve, nodes: Array, points: Array) -> float:
    """Largest departure of the curve from the chord between two data points, in chord lengths.

    Looked at in the middle and the quarters of each interval. A half circle in one interval gives
    0.5; an interpolant that swings between its data (Runge) exceeds 1 soon.
    """
    chords = np.diff(points, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    # Points that nearly coincide, as at a cusp, may not blow the ratio up.
    scale = np.maximum(lengths, 0.05 * max(float(lengths.max()), np.finfo(float).tiny))
    worst = 0.0
    for fraction in (0.25, 0.5, 0.75):
        values = curve.evaluate(nodes[:-1] + fraction * np.diff(nodes))
        offset = values - points[:-1]
        along = np.clip(
            np.einsum('ij,ij->i', offset, chords) / np.maximum(lengths, 1e-300) ** 2, 0.0, 1.0
        )
        distance = np.linalg.norm(offset - along[:, None] * chords, axis=1)
        worst = max(worst, float((distance / scale).max()))
    return worst


def interpolate(
    points: ArrayLike,
    basis: Basis | None = None,
    nodes: ArrayLike | None = None,
    maximum_overshoot: float = 1.0,
) -> HraCurve:
    """Curve through all points: as many control points as points.

    Parameters
    ----------
    points : (n+1, d), metres, n >= 1.
    basis : pair (f, g); None takes the polynomials on [0, 1].
    nodes : parameters (n+1,) in the domain of the basis; None divides it equally, ends included.
    maximum_overshoot : limit of :func:`overshoot` beyond which the result is warned about.

    Raises
    ------
    StageError
        Fewer than two points, points or nodes not finite, nodes unsorted, repeated or outside.

    Warns
    -----
    HraWarning
        The curve swings between the points (Runge), or moves with the origin (odd trigonometric
        degree).
    """
    chosen = basis or Bernstein()
    values = _check_points(points)
    if values.shape[0] < 2:
        raise StageError(f'{values.shape[0]} point is too few to interpolate: give at least 2')
    parameters = _nodes(chosen, nodes, values.shape[0])
    _warn_origin(chosen, values.shape[0] - 1)
    curve = HraCurve(chosen, solve(factorise(chosen, parameters), values))
    swing = overshoot(curve, parameters, values)
    if swing > maximum_overshoot:
        warnings.warn(
            f'the interpolant leaves the chords by {swing:.3g} chord lengths (Runge): use '
            'Chebyshev nodes, a least-squares fit with fewer control points, or a spline',
            HraWarning,
            stacklevel=2,
        )
    return curve


def interpolate_to_tolerance(
    function: Callable[[Array], Array],
    domain: tuple[float, float],
    tolerance: float,
    basis: Basis | None = None,
    maximum_points: int = 61,
) -> HraCurve:
    """Interpolant of a known curve with the fewest points whose error stays in a tolerance.

    Parameters
    ----------
    function : parameters (m,) in ``domain`` -> points (m, d), metres.
    tolerance : largest distance at equal parameter, looked at in eight places between
        neighbouring data, metres.
    maximum_points : the search goes from 2 points to this number, over those whose space
        contains the constants.

    Raises
    ------
    StageError
        If no number of points reaches the tolerance.
    """
    chosen = basis or Bernstein()

    def curve_and_error(count: int) -> tuple[HraCurve, float]:
        points = _check_points(function(parameter_nodes(domain, count)))
        nodes = parameter_nodes(chosen.domain, count)
        curve = HraCurve(chosen, solve(factorise(chosen, nodes), points), domain)
        between = parameter_nodes(domain, 8 * (count - 1) + 1)
        error = np.linalg.norm(curve.evaluate(between) - function(between), axis=1).max()
        return curve, float(error)

    return _simplest(chosen, maximum_points, tolerance, curve_and_error)


def _simplest(
    basis: Basis,
    most: int,
    tolerance: float,
    curve_and_error: Callable[[int], tuple[HraCurve, float]],
) -> HraCurve:
    """The first curve of 2, 3, .. `most` control points whose error [m] stays in a tolerance.

    Tried are only those whose space contains the constants.
    """
    if not tolerance > 0.0:
        raise StageError(f'the tolerance {tolerance} must be positive: give metres')
    best = math.inf
    for count in range(2, most + 1):
        if basis.contains_constants(count - 1):
            curve, error = curve_and_error(count)
            best = min(best, error)
            if best <= tolerance:
                return curve
    raise StageError(
        f'no curve of up to {most} control points stays within {tolerance:.3g} m (the best '
        f'reaches {best:.3g} m): split the curve, raise the tolerance or use a spline'
    )


def least_squares_curve(
    points: ArrayLike,
    control_points: int,
    basis: Basis | None = None,
    nodes: ArrayLike | None = None,
) -> HraCurve:
    """Curve with ``control_points`` control points nearest to the points in least squares.

    Parameters and errors as :func:`interpolate`; more points than control points smooth.
    """
    chosen = basis or Bernstein()
    values = _check_points(points)
    parameters = _nodes(chosen, nodes, values.shape[0])
    if not 1 <= control_points <= values.shape[0]:
        raise StageError(
            f'{control_points} control points from {values.shape[0]} points: '
            'give from 1 to as many as there are points'
        )
    _warn_origin(chosen, control_points - 1)
    coefficients, _ = least_squares(factorise(chosen, parameters, control_points - 1), values)
    return HraCurve(chosen, coefficients)


def fit_to_tolerance(
    points: ArrayLike,
    tolerance: float,
    basis: Basis | None = None,
) -> HraCurve:
    """Least-squares curve with the fewest control points whose residuals stay in a tolerance.

    Tried are 2, 3, .. up to a half of the points (with more, a small residual says little about
    the curve between them), and only those whose space contains the constants.

    Parameters
    ----------
    points : (l+1, d), metres. tolerance : largest distance to a data point, metres.

    Raises
    ------
    StageError
        If no count reaches the tolerance.
    """
    chosen = basis or Bernstein()
    values = _check_points(points)
    parameters = _nodes(chosen, None, values.shape[0])

    def curve_and_error(count: int) -> tuple[HraCurve, float]:
        curve = least_squares_curve(values, count, chosen, parameters)
        distances = np.linalg.norm(curve.evaluate(parameters) - values, axis=1)
        return curve, float(distances.max())

    return _simplest(chosen, min(values.shape[0] // 2, 101), tolerance, curve_and_error)
