"""Positioning figures of ISO 230-2 and circular figures of ISO 230-4, coverage factor 2.

The symbols are those of the standards: an arrow up (here ``_up``) is the approach in the
positive direction, an arrow down (``_down``) in the negative one. All lengths are metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linprog

from stage_core.arrays import Array
from stage_core.errors import StageError

COVERAGE = 2.0


@dataclass(frozen=True)
class Positioning:
    """Evaluation of an axis by ISO 230-2; arrays (m,) over the target positions, scalars in m.

    Attributes
    ----------
    targets : target positions P_i.
    mean_up, mean_down : mean unidirectional positioning deviations.
    deviation_up, deviation_down : estimators s_i of the unidirectional standard uncertainty.
    reversal : reversal values B_i = mean_up - mean_down.
    A, A_up, A_down : accuracy, bidirectional and unidirectional.
    R, R_up, R_down : repeatability.
    E, E_up, E_down : systematic positioning deviation.
    B, B_mean : reversal value of the axis (largest magnitude) and mean reversal value.
    M : mean bidirectional positioning deviation.
    """

    targets: Array
    mean_up: Array
    mean_down: Array
    deviation_up: Array
    deviation_down: Array
    reversal: Array
    A: float
    A_up: float
    A_down: float
    R: float
    R_up: float
    R_down: float
    E: float
    E_up: float
    E_down: float
    B: float
    B_mean: float
    M: float

    @property
    def mean(self) -> Array:
        """Mean bidirectional positioning deviation at each target."""
        return 0.5 * (self.mean_up + self.mean_down)


def positioning(targets: ArrayLike, up: ArrayLike, down: ArrayLike) -> Positioning:
    """Evaluate a positioning test by ISO 230-2.

    Parameters
    ----------
    targets : (m,) target positions P_i, m.
    up, down : (m, n) deviations (actual minus target) at each target, n approaches from below and
        from above, m. The standard asks for n = 5 and m >= 5; n >= 2 is accepted.

    Raises
    ------
    StageError
        Arrays that do not fit, fewer than two approaches, values that are not finite.
    """
    position = np.asarray(targets, dtype=float)
    rising, falling = np.asarray(up, dtype=float), np.asarray(down, dtype=float)
    if position.ndim != 1 or position.size < 1 or rising.ndim != 2 or falling.ndim != 2:
        raise StageError('a positioning test needs targets (m,) and deviations (m, n): reshape')
    if rising.shape[0] != position.size or falling.shape[0] != position.size:
        raise StageError(
            f'{position.size} targets with deviations {rising.shape} and {falling.shape}: '
            'give one row for each target'
        )
    if rising.shape[1] < 2 or falling.shape[1] < 2:
        raise StageError('repeatability needs two approaches in each direction: measure again')
    if not all(np.isfinite(part).all() for part in (position, rising, falling)):
        raise StageError('a deviation is not finite: remove the target')
    mean_up, mean_down = rising.mean(axis=1), falling.mean(axis=1)
    s_up, s_down = rising.std(axis=1, ddof=1), falling.std(axis=1, ddof=1)
    reversal = mean_up - mean_down
    spread_up, spread_down = 2.0 * COVERAGE * s_up, 2.0 * COVERAGE * s_down
    both = COVERAGE * (s_up + s_down) + np.abs(reversal)
    highest_up, lowest_up = mean_up + COVERAGE * s_up, mean_up - COVERAGE * s_up
    highest_down, lowest_down = mean_down + COVERAGE * s_down, mean_down - COVERAGE * s_down
    mean = 0.5 * (mean_up + mean_down)
    return Positioning(
        targets=position,
        mean_up=mean_up,
        mean_down=mean_down,
        deviation_up=s_up,
        deviation_down=s_down,
        reversal=reversal,
        A=float(
            max(highest_up.max(), highest_down.max()) - min(lowest_up.min(), lowest_down.min())
        ),
        A_up=float(highest_up.max() - lowest_up.min()),
        A_down=float(highest_down.max() - lowest_down.min()),
        R=float(np.maximum(np.maximum(both, spread_up), spread_down).max()),
        R_up=float(spread_up.max()),
        R_down=float(spread_down.max()),
        E=float(max(mean_up.max(), mean_down.max()) - min(mean_up.min(), mean_down.min())),
        E_up=float(np.ptp(mean_up)),
        E_down=float(np.ptp(mean_down)),
        B=float(np.abs(reversal).max()),
        B_mean=float(reversal.mean()),
        M=float(np.ptp(mean)),
    )


def _check_path(path: ArrayLike) -> Array:
    points = np.asarray(path, dtype=float)
    if points.ndim != 2 or points.shape[1] != 2 or points.shape[0] < 8:
        raise StageError(f'a circular path of shape {points.shape}: give at least 8 points (n, 2)')
    if not np.isfinite(points).all():
        raise StageError('a point of the circular path is not finite: remove it')
    return points


def least_squares_circle(path: ArrayLike) -> tuple[Array, float]:
    """Centre (2,) and radius of the least-squares circle, by Gauss-Newton on the distances."""
    points = _check_path(path)
    origin = points.mean(axis=0)
    shifted = points - origin
    scale = float(np.abs(shifted).max())
    if scale == 0.0:
        raise StageError('all points of the circular path coincide: record a motion')
    shifted = shifted / scale
    # The algebraic circle starts the iteration; near a circle it is already close.
    design = np.column_stack([2.0 * shifted, np.ones(len(shifted))])
    solution, _, rank, _ = np.linalg.lstsq(design, (shifted**2).sum(axis=1), rcond=None)
    if rank < 3:
        raise StageError('the points of the circular path lie on a line: record both axes')
    centre = solution[:2]
    radius = 0.0
    for _ in range(20):
        offset = shifted - centre
        distance = np.maximum(np.linalg.norm(offset, axis=1), np.finfo(float).tiny)
        jacobian = np.column_stack([offset / distance[:, None], np.ones(len(shifted))])
        update = np.linalg.lstsq(jacobian, distance, rcond=None)[0]
        centre = centre + update[:2]
        radius = float(update[2])
        if np.abs(update[:2]).max() < 1e-15:
            break
    return origin + scale * centre, scale * radius


def minimum_zone(path: ArrayLike) -> tuple[float, Array]:
    """Smallest radial separation of two concentric circles that enclose the path, and the centre.

    Linear programmes for the centre, each about the last one, until the separation settles.
    """
    points = _check_path(path)
    centre, radius = least_squares_circle(points)
    best, best_centre = np.inf, centre
    for _ in range(8):
        offset = points - centre
        distance = np.linalg.norm(offset, axis=1)
        separation = float(np.ptp(distance))
        if separation >= best - 1e-12 * radius:
            break
        best, best_centre = separation, centre
        if separation <= 1e-12 * radius:
            break
        # Unknowns: the step of the centre and the two radii, all in units of the separation.
        level = (distance - distance.mean()) / separation
        direction = offset / distance[:, None]
        ones, zeros = np.ones(len(points)), np.zeros(len(points))
        constraints = np.vstack(
            [
                np.column_stack([-direction, -ones, zeros]),
                np.column_stack([direction, zeros, ones]),
            ]
        )
        result = linprog(
            [0.0, 0.0, 1.0, -1.0],
            A_ub=constraints,
            b_ub=np.concatenate([-level, level]),
            bounds=[(None, None)] * 4,
        )
        if not result.success:
            break
        centre = centre + separation * result.x[:2]
    return best, best_centre


@dataclass(frozen=True)
class Circular:
    """Evaluation of circular paths by ISO 230-4; lengths in m.

    Attributes
    ----------
    radius : nominal radius. centre : nominal centre (2,).
    G : circular deviation of the counter-clockwise path (minimum zone).
    G_clockwise, G_b : of the clockwise path, and of both together; None without that path.
    F_max, F_min : largest and smallest radial deviation of all points from the nominal circle
        about the nominal centre.
    H : circular hysteresis, the largest radial difference of the two paths at one angle.
    D : mean bidirectional radial deviation, least-squares radius minus nominal radius.
    """

    radius: float
    centre: Array
    G: float
    G_clockwise: float | None
    G_b: float | None
    F_max: float
    F_min: float
    H: float | None
    D: float


def radius_over_angle(path: ArrayLike, centre: ArrayLike, angles: Array) -> Array:
    """Mean radius of a path in the sector around each of the equally spaced angles (rad).

    Sectors without a point are interpolated, over the full turn.
    """
    offset = _check_path(path) - np.asarray(centre, dtype=float)
    radius = np.linalg.norm(offset, axis=1)
    angle = np.arctan2(offset[:, 1], offset[:, 0])
    count = angles.size
    sector = np.round((angle - angles[0]) / (2.0 * np.pi) * count).astype(int) % count
    hits = np.bincount(sector, minlength=count)
    sums = np.bincount(sector, weights=radius, minlength=count)
    filled = np.flatnonzero(hits)
    return np.interp(np.arange(count), filled, sums[filled] / hits[filled], period=count)


def circular(
    counter_clockwise: ArrayLike,
    clockwise: ArrayLike | None = None,
    radius: float | None = None,
    centre: ArrayLike | None = None,
    sectors: int = 360,
) -> Circular:
    """Evaluate circular paths by ISO 230-4.

    Parameters
    ----------
    counter_clockwise, clockwise : measured points (n, 2) of the two contouring directions, m.
    radius, centre : nominal circle, m; None takes that of the least-squares circle of all
        points, and the radial deviation F then holds no centring error and no mean radius error.
    sectors : angles at which the two directions are compared for H.
    """
    if sectors < 8:
        raise StageError(f'{sectors} sectors are too few to compare two paths: give at least 8')
    first = _check_path(counter_clockwise)
    second = None if clockwise is None else _check_path(clockwise)
    points = first if second is None else np.vstack([first, second])
    fitted_centre, fitted_radius = least_squares_circle(points)
    nominal_radius = fitted_radius if radius is None else float(radius)
    nominal_centre = fitted_centre if centre is None else np.asarray(centre, dtype=float)
    if not nominal_radius > 0.0:
        raise StageError(f'the nominal radius {nominal_radius} m must be positive')
    deviation = np.linalg.norm(points - nominal_centre, axis=1) - nominal_radius
    hysteresis = None
    if second is not None:
        angles = 2.0 * np.pi * np.arange(sectors) / sectors
        difference = radius_over_angle(first, fitted_centre, angles) - radius_over_angle(
            second, fitted_centre, angles
        )
        hysteresis = float(np.abs(difference).max())
    return Circular(
        radius=nominal_radius,
        centre=nominal_centre,
        G=minimum_zone(first)[0],
        G_clockwise=None if second is None else minimum_zone(second)[0],
        G_b=None if second is None else minimum_zone(points)[0],
        F_max=float(deviation.max()),
        F_min=float(deviation.min()),
        H=hysteresis,
        D=fitted_radius - nominal_radius,
    )
