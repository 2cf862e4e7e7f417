"""The contours: circle, rounded square, star, eight, free form, NURBS, any callable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline

from contour_ctrl import nurbs
from hra_curves.arc_length import Curve
from stage_core.arrays import Array
from stage_core.errors import StageError

NAMES = ('circle', 'square', 'star', 'eight', 'freeform', 'nurbs', 'hra')


@dataclass(frozen=True)
class CallableCurve:
    """A contour from any function u (n,) -> (n, 2) [m].

    `exact` (u, order) -> (order + 1, n, 2) gives derivatives where they are known; without
    it they come from a quintic spline through `samples` + 1 points of the function, whose
    error is of the sixth order in the spacing.
    """

    function: Callable[[Array], Array]
    domain: tuple[float, float]
    closed: bool = False
    exact: Callable[[Array, int], Array] | None = None
    samples: int = 2000

    @property
    def breaks(self) -> Array:
        """(2,) the ends of the domain."""
        return np.array(self.domain)

    def derivatives(self, parameter: ArrayLike, order: int) -> Array:
        """Return (order + 1, n, 2): the point [m] and its derivatives by the parameter."""
        u = np.clip(np.atleast_1d(np.asarray(parameter, dtype=float)), *self.domain)
        if self.exact is not None:
            return self.exact(u, order)
        return np.stack([self._spline(u, nu) for nu in range(order + 1)])

    @cached_property
    def _spline(self) -> Callable[..., Array]:
        u = np.linspace(*self.domain, self.samples + 1)
        points = np.asarray(self.function(u), dtype=float)
        if points.shape != (len(u), 2) or not np.all(np.isfinite(points)):
            raise StageError('the curve function must return finite (n, 2) points in metres')
        if self.closed:
            points[-1] = points[0]
        return make_interp_spline(u, points, k=5, bc_type='periodic' if self.closed else None)


def circle(
    radius: float, centre: tuple[float, float] = (0.0, 0.0), clockwise: bool = False
) -> nurbs.NurbsCurve:
    """Exact circle [m] as the nine-point rational quadratic (paper 3, figure 8a)."""
    _positive('radius', radius)
    corner = np.sqrt(0.5)
    square = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)]
    corners = np.array(square[::-1] if clockwise else square)
    knots = np.array([0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]) / 4.0
    weights = np.array([1, corner, 1, corner, 1, corner, 1, corner, 1])
    return nurbs.NurbsCurve(2, knots, np.asarray(centre) + radius * corners, weights)


def rounded_polygon(vertices: ArrayLike, corner_radius: float) -> nurbs.NurbsCurve:
    """Closed polygon (n, 2) [m] whose corners are quintic blends of continuous curvature.

    `corner_radius` [m] is the smallest radius of curvature in each corner. A circular arc
    would jump in curvature where it meets the side, and ask the axes for infinite jerk.
    The curve starts in the middle of the last side.

    Raises
    ------
    StageError
        A zero-length side, a reversal of direction (cusp), or corners that do not fit.
    """
    corners = np.asarray(vertices, dtype=float)
    _positive('corner_radius', corner_radius)
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(sides, axis=1)
    if np.any(lengths <= 1e-9 * lengths.max()):
        index = int(np.argmin(lengths))
        raise StageError(f'zero-length segment: side {index} of the polygon; remove the vertex')
    leaving = sides / lengths[:, None]
    arriving = np.roll(leaving, 1, axis=0)
    turning = np.einsum('ij,ij->i', arriving, leaving)
    if np.any(turning < -1.0 + 1e-6):
        index = int(np.argmin(turning))
        raise StageError(f'cusp: the polygon reverses at vertex {index}; move the vertex')
    shares = np.array([1.0, 0.65, 0.3])
    blends = []
    for vertex, before, after in zip(corners, arriving, leaving, strict=True):
        unit = np.vstack([-shares[:, None] * before, shares[::-1, None] * after])
        reach = corner_radius / _smallest_radius(unit)
        blends.append((reach, vertex + reach * unit))
    reaches = np.array([reach for reach, _ in blends])
    room = lengths - reaches - np.roll(reaches, -1)
    if np.any(room <= 1e-6 * lengths):
        largest = corner_radius * float(np.min(lengths / (lengths - room))) * 0.999
        raise StageError(
            f'corner_radius {corner_radius:g} m does not fit the sides: at most {largest:.4g} m'
        )
    segments = []
    start = 0.5 * (blends[-1][1][-1] + blends[0][1][0])
    previous = start
    for _, blend in blends:
        segments.append(_line(previous, blend[0]))
        segments.append(blend)
        previous = blend[-1]
    segments.append(_line(previous, start))
    return nurbs.bezier_chain(np.array(segments))


def square(
    side: float, corner_radius: float, centre: tuple[float, float] = (0.0, 0.0)
) -> nurbs.NurbsCurve:
    """Square [m] with rounded corners of continuous curvature, counter-clockwise."""
    _positive('side', side)
    half = 0.5 * side
    vertices = np.array([(half, half), (-half, half), (-half, -half), (half, -half)])
    return rounded_polygon(np.asarray(centre) + vertices, corner_radius)


def star(
    radius: float,
    inner_radius: float,
    corner_radius: float,
    points: int = 5,
    centre: tuple[float, float] = (0.0, 0.0),
) -> nurbs.NurbsCurve:
    """Star [m] with `points` rounded points between `radius` and `inner_radius`."""
    _positive('radius', radius)
    _positive('inner_radius', inner_radius)
    if points < 3:
        raise StageError('a star needs at least 3 points')
    angle = np.pi * np.arange(2 * points) / points
    reach = np.where(np.arange(2 * points) % 2 == 0, radius, inner_radius)
    vertices = reach[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return rounded_polygon(np.asarray(centre) + vertices, corner_radius)


def eight(width: float, height: float, centre: tuple[float, float] = (0.0, 0.0)) -> CallableCurve:
    """Gerono's lemniscate [m]: x = width/2 sin u, y = height/2 sin 2u."""
    _positive('width', width)
    _positive('height', height)
    middle = np.asarray(centre, dtype=float)

    def exact(u: Array, order: int) -> Array:
        result = np.empty((order + 1, len(u), 2))
        for k in range(order + 1):
            result[k, :, 0] = 0.5 * width * np.sin(u + 0.5 * np.pi * k)
            result[k, :, 1] = 0.5 * height * 2.0**k * np.sin(2.0 * u + 0.5 * np.pi * k)
        result[0] += middle
        return result

    return CallableCurve(lambda u: exact(u, 0)[0], (0.0, 2.0 * np.pi), True, exact)


#: Turn of a tangent that is no corner [rad].
CORNER = 1e-3


def check_regular(curve: Curve) -> None:
    """Refuse a curve that an axis cannot follow at any feed.

    Raises
    ------
    StageError
        A zero-length piece (speed of the parameter vanishes), or a jump of the tangent's
        direction of more than `CORNER` that remains under bisection.
    """
    breaks = curve.breaks
    per_piece = max(2048 // max(len(breaks) - 1, 1), 16)
    u = np.unique(
        np.concatenate(
            [
                np.linspace(a, b, per_piece + 1)
                for a, b in zip(breaks[:-1], breaks[1:], strict=True)
            ]
        )
    )
    first = curve.derivatives(u, 1)[1]
    speed = np.linalg.norm(first, axis=1)
    if not np.all(np.isfinite(speed)):
        raise StageError('the curve is not finite everywhere: correct its definition')
    slow = np.flatnonzero(speed <= 1e-7 * np.median(speed))
    if len(slow) or np.median(speed) == 0.0:
        where = u[slow[0]] if len(slow) else u[0]
        raise StageError(
            f'the curve has a cusp or a zero-length segment at parameter {where:.6g}: '
            'its tangent vanishes there; remove the repeated point'
        )
    # Six intervals that turn most: a smooth one turns less and less as it is halved.
    turns = np.abs(_turn(first[:-1], first[1:]))
    for index in np.argsort(turns)[-6:]:
        low, high = u[index], u[index + 1]
        turn = turns[index]
        for _ in range(40):
            if turn <= CORNER:
                break
            middle = 0.5 * (low + high)
            low_t, middle_t, high_t = curve.derivatives([low, middle, high], 1)[1]
            left, right = abs(_turn(low_t, middle_t)), abs(_turn(middle_t, high_t))
            low, high, turn = (low, middle, left) if left > right else (middle, high, right)
        if turn > CORNER:
            raise StageError(
                f'the curve has a cusp or corner of {np.degrees(turn):.1f} deg at parameter '
                f'{low:.6g}: no feed can follow it; round it'
            )


def _turn(before: Array, after: Array) -> Array:
    """Angle [rad] from the first direction to the second."""
    cross = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
    return np.arctan2(cross, np.sum(before * after, axis=-1))


def _smallest_radius(blend: Array) -> float:
    """Smallest radius of curvature of one quintic Bezier segment (6, 2)."""
    piece = nurbs.bezier_chain(blend[None])
    first, second = piece.derivatives(np.linspace(*piece.domain, 401), 2)[1:]
    bend = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    return float(1.0 / np.max(bend / np.linalg.norm(first, axis=1) ** 3))


def _line(start: Array, stop: Array) -> Array:
    share = np.linspace(0.0, 1.0, 6)[:, None]
    return start + share * (stop - start)


def _positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0.0):
        raise StageError(f'{name} is {value}: give a positive number of metres')
