"""From a contour to what the control tick reads: position, velocity, angle at each tick."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from contour_ctrl.contour_error import of_record
from contour_ctrl.curves import check_regular
from contour_ctrl.feedrate import AxisLimits, SCurve
from contour_ctrl.path import PathTable, arc_derivatives, sampled_derivatives
from hra_curves.arc_length import ArcLength, Curve
from stage_core.arrays import Array
from stage_core.errors import StageError


@dataclass(frozen=True)
class Reference:
    """A contour sampled at the control ticks, from rest to rest.

    Attributes
    ----------
    period
        Control period [s].
    position, velocity, acceleration
        (n, 2) in m, m/s, m/s^2.
    angle
        (n,) direction of the tangent at the tick's reference point [rad].
    arc
        (n,) arc length [m], beyond the path's length in later laps.
    path
        The geometry without the clock, for the contour error; None for a motion that has none.
    feed
        Feed that is reached [m/s].
    fluctuation
        Largest deviation of the distance between neighbouring set-points per tick from the
        planned feed while cruising, as a share of the feed.
    wanted
        `digest` of what a corrected reference was made of; empty where nothing was corrected.
    """

    period: float
    position: Array
    velocity: Array
    acceleration: Array
    angle: Array
    arc: Array
    path: PathTable | None
    feed: float
    fluctuation: float
    wanted: str = ''

    def __len__(self) -> int:
        """Return the number of ticks."""
        return len(self.position)

    def digest(self) -> str:
        """Hash of the wanted ticks and the period: what is learned is learned for these.

        A correction moves them by micrometres, which changes little of what a loop has to learn.
        Positions are rounded to 1 nm, so that the hash survives another processor's rounding.
        """
        if self.wanted:
            return self.wanted
        ticks = np.round(self.position * 1e9).astype(np.int64)
        return hashlib.sha256(ticks.tobytes() + repr(self.period).encode()).hexdigest()

    def contour_errors(self, measured: Array) -> Array:
        """Contour error (n,) [m] of the encoder (n, 2) at each tick.

        A motion without a path has no nearest point: its error is taken across its direction.
        """
        if self.path is not None:
            return of_record(self.path, self.arc, measured)
        x, y = (self.position - measured).T
        return -np.sin(self.angle) * x + np.cos(self.angle) * y

    def corrected(self, invert: Callable[[Array], Array]) -> Reference:
        """Reference in stage coordinates: `invert` maps wanted table points (n, 2) to them.

        Velocity and acceleration follow from the corrected points, and the path with them.
        """
        if self.path is None:
            raise StageError('a motion that follows no contour is not corrected')
        position = np.asarray(invert(self.position), dtype=float)
        points = np.asarray(invert(self.path.values[:, :2]), dtype=float)
        if not (np.all(np.isfinite(position)) and np.all(np.isfinite(points))):
            raise StageError(
                'the calibration model cannot be inverted on this contour: '
                'retrain it on a workspace that holds the contour, or deactivate it'
            )
        _, velocity, acceleration = sampled_derivatives(position, self.period)
        velocity[[0, -1]] = 0.0
        path = PathTable.from_points(points, self.path.length, self.path.closed)
        index = np.minimum(
            np.rint(np.mod(self.arc, path.length) / path.step).astype(int), len(points) - 1
        )
        tangent = path.values[index, 2:4]
        return replace(
            self,
            position=position,
            velocity=velocity,
            acceleration=acceleration,
            angle=np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0])),
            path=path,
            wanted=self.digest(),
        )

    def braked(self, tick: int, stop_time: float, learned: Array) -> tuple[Reference, Array]:
        """Reference from `tick` that comes to rest on the same path within `stop_time` [s].

        Also returns the `learned` signal (n, 2) on the slowed clock, fading with the rate.

        The clock of the plan is slowed from 1 to 0 along a half cosine (a feed hold), so the
        stage stays on the contour and the acceleration stays bounded.
        """
        count = max(int(np.ceil(stop_time / self.period)), 2)
        phase = np.arange(count + 1) / count
        rate = 0.5 * (1.0 + np.cos(np.pi * phase))
        clock = count * (0.5 * phase + np.sin(np.pi * phase) / (2.0 * np.pi)) + tick
        first = min(max(tick - 2, 0), max(len(self) - 4, 0))
        window = slice(first, first + count + 6)
        grid = np.arange(len(self), dtype=float)[window]
        clock = np.minimum(clock, grid[-1])

        def at(values: Array) -> Array:
            return make_interp_spline(grid, values[window], k=3)(clock)

        velocity = at(self.velocity) * rate[:, None]
        faded = at(learned) * rate[:, None]
        reference = replace(
            self,
            position=at(self.position),
            velocity=velocity,
            acceleration=np.gradient(velocity, self.period, axis=0),
            angle=at(self.angle),
            arc=at(self.arc),
        )
        return reference, faded


#: Most ticks of one iteration; half an hour at 1 kHz.
LONGEST = 2_000_000
#: The highest possible feed is not looked for where an iteration takes more ticks than this.
SLOWEST = 200_000


def plan(
    curve: Curve,
    feed: float,
    period: float = 0.001,
    limits: AxisLimits | None = None,
    path_acceleration: float = 1.0,
    path_jerk: float = 50.0,
    laps: int = 1,
    reduce_feed: bool = False,
) -> Reference:
    """Interpolate a contour at constant feed with jerk-limited ramps.

    Parameters
    ----------
    feed
        Wanted feed along the arc [m/s].
    period
        Control period [s].
    limits
        What the axes can do; the defaults of `AxisLimits` when None.
    path_acceleration, path_jerk
        Limits of the ramps along the arc [m/s^2], [m/s^3].
    laps
        How often a closed contour is followed.
    reduce_feed
        Take the highest feed that the axes can follow instead of refusing.

    Raises
    ------
    StageError
        A cusp or zero-length segment; a feed the axes cannot follow, with the limit that
        binds and the highest possible feed.
    """
    _check(curve, period, laps)
    bounds = AxisLimits() if limits is None else limits
    arc = ArcLength.of(curve)
    path = PathTable.from_curve(arc)
    if feed > 0.0:
        _refuse_endless(feed, laps * arc.total / (feed * period))

    def attempt(wanted: float) -> Reference:
        profile = SCurve.plan(laps * arc.total, wanted, path_acceleration, path_jerk)
        return _sample(arc, path, profile, period)

    reference = attempt(feed)
    excess, name, tick = _excess(reference, bounds)
    if excess <= 1.0:
        return reference
    where = f'{name} at arc {np.mod(reference.arc[tick], arc.total):.4g} m'
    # Nothing falls faster than the jerk, with the third power of the feed.
    least = feed * excess ** (-1.0 / 3.0)
    low, high = _highest_feed(
        feed,
        lambda wanted: laps * arc.total / (min(wanted, least) * period) > SLOWEST,
        lambda wanted: _excess(attempt(wanted), bounds)[0] <= 1.0,
    )
    _refuse_feed(feed, low, high, where, reduce_feed)
    return attempt(low)


def _refuse_feed(feed: float, low: float, high: float, where: str, reduce_feed: bool) -> None:
    """Refuse a feed that exceeds what binds `where`: always if none is possible (`low` is 0)."""
    if low == 0.0:
        raise StageError(
            f'no feed of {high:.2g} m/s or more keeps the {where}: smooth the curve there, or '
            'lower path_acceleration and path_jerk'
        )
    if not reduce_feed:
        raise StageError(
            f'the feed of {feed:g} m/s exceeds the {where}: the highest feed is {low:.4g} m/s'
        )


def _refuse_endless(feed: float, ticks: float) -> None:
    if ticks > LONGEST:
        raise StageError(
            f'at a feed of {feed:g} m/s the contour takes {ticks:.2g} ticks, more than '
            f'{LONGEST:.2g}: raise feed, or lower control_rate or laps'
        )


def _check(curve: Curve, period: float, laps: int) -> None:
    if not (np.isfinite(period) and period > 0.0):
        raise StageError(f'the control period must be positive, not {period} s')
    if laps < 1 or (laps > 1 and not curve.closed):
        raise StageError(f'{laps} laps: an open contour has one lap, a closed one at least one')
    check_regular(curve)


def _highest_feed(
    feed: float, too_slow: Callable[[float], bool], possible: Callable[[float], bool]
) -> tuple[float, float]:
    """Highest possible and lowest impossible feed [m/s] below `feed`; 0 where none is possible."""
    low, high = 0.0, feed
    for _ in range(14):
        middle = 0.5 * (low + high)
        if too_slow(middle):
            break
        if possible(middle):
            low = middle
        else:
            high = middle
    return low, high


def _excess(reference: Reference, limits: AxisLimits) -> tuple[float, str, int]:
    jerk = np.diff(reference.acceleration, axis=0, append=0.0) / reference.period
    return limits.excess(reference.velocity, reference.acceleration, jerk)


def _sample(arc: ArcLength, path: PathTable, profile: SCurve, period: float) -> Reference:
    count = int(np.ceil(profile.duration / period - 1e-9)) + 1
    s, speed, acceleration = profile.at(period * np.arange(count))
    wrapped = np.where(s > 0.0, s - arc.total * np.ceil(s / arc.total - 1.0), 0.0)
    position, tangent, bend = arc_derivatives(arc.curve, arc.parameter(wrapped))
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1) / period
    planned = np.diff(s) / period
    cruising = planned > (1.0 - 1e-9) * profile.feed
    fluctuation = np.max(np.abs(steps - planned)[cruising], initial=0.0) / profile.feed
    return Reference(
        period=period,
        position=position,
        velocity=tangent * speed[:, None],
        acceleration=tangent * acceleration[:, None] + bend * speed[:, None] ** 2,
        angle=np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0])),
        arc=s,
        path=path,
        feed=profile.feed,
        fluctuation=float(fluctuation),
    )
