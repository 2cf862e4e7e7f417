"""Non-uniform rational B-splines in the plane, evaluated on homogeneous coordinates."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import comb

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, make_interp_spline

from stage_core.arrays import Array
from stage_core.errors import StageError


@dataclass(frozen=True)
class NurbsCurve:
    """A planar NURBS curve C(u) = sum N_i(u) w_i P_i / sum N_i(u) w_i.

    Parameters
    ----------
    degree
        Polynomial degree p >= 1.
    knots
        (m,) non-decreasing knot vector, m = number of control points + p + 1.
    control_points
        (n, 2) control points [m].
    weights
        (n,) positive weights; all ones when None.
    """

    degree: int
    knots: Array
    control_points: Array
    weights: Array | None = None
    _spline: BSpline = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        knots = np.asarray(self.knots, dtype=float)
        points = np.asarray(self.control_points, dtype=float)
        if points.ndim != 2 or points.shape[1] != 2:
            raise StageError('NURBS control_points must be a list of [x, y] pairs: correct them')
        weights = np.ones(len(points)) if self.weights is None else np.asarray(self.weights, float)
        if self.degree < 1 or len(points) <= self.degree:
            raise StageError(
                f'a NURBS curve of degree {self.degree} needs more than {self.degree} control '
                f'points, {len(points)} were given: add points or lower the degree'
            )
        if len(knots) != len(points) + self.degree + 1:
            raise StageError(
                f'{len(points)} control points of degree {self.degree} need '
                f'{len(points) + self.degree + 1} knots, {len(knots)} were given: correct knots'
            )
        if weights.shape != (len(points),) or not np.all(weights > 0.0):
            raise StageError('NURBS weights must be positive, one for each control point')
        if not all(np.all(np.isfinite(values)) for values in (knots, points, weights)):
            raise StageError('the NURBS curve holds a value that is not finite: correct the file')
        if np.any(np.diff(knots) < 0.0) or knots[self.degree] >= knots[-self.degree - 1]:
            raise StageError('NURBS knots must not decrease and must span an interval')
        object.__setattr__(self, 'knots', knots)
        object.__setattr__(self, 'control_points', points)
        object.__setattr__(self, 'weights', weights)
        homogeneous = np.column_stack([points * weights[:, None], weights])
        object.__setattr__(self, '_spline', BSpline(knots, homogeneous, self.degree))

    @property
    def domain(self) -> tuple[float, float]:
        """First and last parameter."""
        return float(self.knots[self.degree]), float(self.knots[-self.degree - 1])

    @property
    def breaks(self) -> Array:
        """(k,) distinct knots of the domain, where the smoothness may drop."""
        first, last = self.domain
        return np.unique(np.clip(self.knots, first, last))

    @property
    def closed(self) -> bool:
        """Whether the last point is the first one."""
        ends = self.derivatives(np.array(self.domain), 0)[0]
        span = np.ptp(self.control_points, axis=0).max()
        return bool(np.linalg.norm(ends[1] - ends[0]) <= 1e-9 * span)

    def derivatives(self, parameter: ArrayLike, order: int) -> Array:
        """Return (order + 1, n, 2): the point and its derivatives by the parameter.

        The quotient rule on the homogeneous curve (Piegl and Tiller, The NURBS Book, eq. 4.8).
        `BSpline.derivative` refuses double knots, evaluation with `nu` does not.
        """
        first, last = self.domain
        u = np.clip(np.atleast_1d(np.asarray(parameter, dtype=float)), first, last)
        homogeneous = [self._spline(u, nu) for nu in range(order + 1)]
        weight = homogeneous[0][:, 2:3]
        result = np.empty((order + 1, len(u), 2))
        for k in range(order + 1):
            value = homogeneous[k][:, :2].copy()
            for i in range(1, k + 1):
                value -= comb(k, i) * homogeneous[i][:, 2:3] * result[k - i]
            result[k] = value / weight
        return result


def bezier_chain(segments: Array) -> NurbsCurve:
    """Join Bezier segments (m, p + 1, 2) [m] end to end into one NURBS of degree p.

    The parameter grows by each segment's chord, so that its speed stays near 1 m per unit.
    """
    degree = segments.shape[1] - 1
    chords = np.linalg.norm(segments[:, -1] - segments[:, 0], axis=1)
    corners = np.concatenate([[0.0], np.cumsum(chords)])
    knots = np.concatenate([[0.0], np.repeat(corners, degree), [corners[-1]]])
    points = np.vstack([segments[0, :1], segments[:, 1:].reshape(-1, 2)])
    return NurbsCurve(degree, knots, points)


def interpolate(points: ArrayLike, closed: bool, degree: int = 5) -> NurbsCurve:
    """Interpolate (n, 2) points [m] by a B-spline on the chord length.

    A closed curve passes through the first point again and is periodic in all derivatives
    up to `degree` - 1.

    Raises
    ------
    StageError
        Fewer points than the degree needs, a value that is not finite, or two equal
        neighbours (a zero-length segment).
    """
    nodes = np.asarray(points, dtype=float)
    if nodes.ndim != 2 or nodes.shape[1] != 2 or len(nodes) == 0:
        raise StageError('a free-form curve is a list of points [x, y]')
    if not np.all(np.isfinite(nodes)):
        raise StageError('a point of the free-form curve is not finite: correct it')
    if closed and np.any(nodes[0] != nodes[-1]):
        nodes = np.vstack([nodes, nodes[:1]])
    if len(nodes) <= degree:
        raise StageError(f'a free-form curve needs at least {degree + 1 - closed} points [x, y]')
    chords = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    span = float(np.ptp(nodes, axis=0).max())
    short = np.flatnonzero(chords <= 1e-9 * span)
    if len(short):
        raise StageError(
            f'zero-length segment between points {short[0] + 1} and {short[0] + 2} of the '
            'free-form curve: remove one of them'
        )
    parameter = np.concatenate([[0.0], np.cumsum(chords)])
    spline = make_interp_spline(parameter, nodes, k=degree, bc_type='periodic' if closed else None)
    return NurbsCurve(degree, spline.t, spline.c)
