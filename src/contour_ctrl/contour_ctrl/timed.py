"""A motion whose times are given: a table of time and position, no path that is followed."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import make_interp_spline

from contour_ctrl.feedrate import AxisLimits
from contour_ctrl.reference import LONGEST, Reference
from stage_core.arrays import Array
from stage_core.errors import StageError

COLUMNS = 't,x,y'


def free_motion(period: float, position: Array, velocity: Array, acceleration: Array) -> Reference:
    """Reference of a motion (n, 2) that follows no contour: it has no path."""
    return Reference(
        period=period,
        position=position,
        velocity=velocity,
        acceleration=acceleration,
        angle=np.arctan2(velocity[:, 1], velocity[:, 0]),
        arc=np.zeros(len(position)),
        path=None,
        feed=float(np.linalg.norm(velocity, axis=1).max()),
        fluctuation=0.0,
    )


def from_text(text: str, origin: str, period: float, limits: AxisLimits) -> Reference:
    """Reference of a table with the columns ``t,x,y`` [s, m, m], a quintic spline through it.

    Raises
    ------
    StageError
        If the text is no such table, or an axis cannot follow the motion.
    """
    time, position = _table(text, origin)
    spline = make_interp_spline(time, position, k=5)
    ticks = time[0] + period * np.arange(int((time[-1] - time[0]) / period + 1e-6) + 1)
    if len(ticks) > LONGEST:
        raise StageError(f'{origin} lasts {len(ticks):.2g} ticks, more than {LONGEST:.2g}')
    position, velocity, acceleration = (spline(ticks, nu) for nu in range(3))
    velocity[[0, -1]] = 0.0
    excess, name, tick = limits.excess(velocity, acceleration, spline(ticks, 3))
    if excess > 1.0:
        raise StageError(f'{origin} exceeds the {name} at {period * tick:.3f} s: slow it down')
    return free_motion(period, position, velocity, acceleration)


def _table(text: str, origin: str) -> tuple[Array, Array]:
    """Times (n,) [s] and positions (n, 2) [m]."""
    head, _, body = text.partition('\n')
    remedy = f'give a first line {COLUMNS} and rows of numbers in s and m'
    if head.strip() != COLUMNS:
        raise StageError(f'{origin} is no timed motion: {remedy}')
    rows: list[list[float]] = []
    for number, line in enumerate(body.splitlines(), 2):
        where = f'{origin}, line {number}'
        row = _numbers(line)
        if len(row) != 3:
            raise StageError(f'{where}: {line[:40]!r} is not three finite numbers: {remedy}')
        if rows and row[0] <= rows[-1][0]:
            raise StageError(
                f'{where}: the time {row[0]:g} s must be above that of the line before'
            )
        rows.append(row)
    if len(rows) < 6:
        raise StageError(f'{origin} needs six rows at least: {remedy}')
    table = np.array(rows)
    return table[:, 0], table[:, 1:]


def _numbers(line: str) -> list[float]:
    """The numbers of a row; none where one of them is no finite number."""
    try:
        found = [float(word) for word in line.split(',')]
    except ValueError:
        return []
    return found if all(map(math.isfinite, found)) else []
