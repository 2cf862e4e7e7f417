"""Arc length of a curve and feed at constant speed along it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stage_core.arrays import Array
from stage_core.errors import StageError

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
_BISECTIONS = 60
#: Arc lengths that are inverted together: what they need stays in the processor's cache.
_BLOCK = 4096


class Curve(Protocol):
    """What arc length and the contour controller ask of a curve in the plane."""

    @property
    def domain(self) -> tuple[float, float]:
        """First and last parameter."""

    @property
    def breaks(self) -> Array:
        """(k,) parameters, the domain's ends included, where the smoothness may drop."""

    @property
    def closed(self) -> bool:
        """Whether the last point is the first one."""

    def derivatives(self, parameter: ArrayLike, order: int) -> Array:
        """Return (order + 1, n, 2): the point [m] and its derivatives by the parameter."""


def _speed(curve: Curve, u: Array) -> Array:
    return np.asarray(np.linalg.norm(curve.derivatives(u, 1)[1], axis=1))


def _integral(curve: Curve, first: Array, last: Array) -> Array:
    """Gauss-Legendre integral of the speed over each interval, 6 points."""
    half = 0.5 * (last - first)
    u = (0.5 * (first + last))[:, None] + half[:, None] * _NODES
    return np.asarray(half * (_speed(curve, u.ravel()).reshape(u.shape) @ _WEIGHTS))


def _cells(table: Array, values: Array) -> NDArray[np.int64]:
    """Cell of an increasing table (k,) that each value lies in, from 0 to k - 2."""
    return np.clip(np.searchsorted(table, values, side='right') - 1, 0, table.size - 2)


@dataclass(frozen=True)
class ArcLength:
    """Table of the arc length of a curve, exact to rounding where the curve is smooth.

    Attributes
    ----------
    parameters, lengths : (cells+1,) parameter and length from the start, metres.
    """

    curve: Curve
    parameters: Array
    lengths: Array

    @classmethod
    def of(cls, curve: Curve, cells: int = 512) -> ArcLength:
        """Build the table of a curve in about so many cells, none of which straddles a break."""
        if cells < 1:
            raise StageError(f'{cells} cells: give at least 1')
        breaks = np.asarray(curve.breaks, dtype=float)
        span = np.diff(breaks)
        counts = np.maximum(np.ceil(cells * span / span.sum()).astype(int), 4)
        edges = [
            np.linspace(breaks[i], breaks[i + 1], counts[i] + 1)[:-1] for i in range(span.size)
        ]
        parameters = np.concatenate([*edges, breaks[-1:]])
        pieces = _integral(curve, parameters[:-1], parameters[1:])
        return cls(curve, parameters, np.concatenate(([0.0], np.cumsum(pieces))))

    @property
    def total(self) -> float:
        """Length of the whole curve, metres."""
        return float(self.lengths[-1])

    def length(self, u: ArrayLike) -> Array:
        """Arc length from the start to parameter u, metres, shape of u."""
        values = np.asarray(u, dtype=float)
        cell = _cells(self.parameters, values.ravel())
        part = _integral(self.curve, self.parameters[cell], values.ravel())
        return (self.lengths[cell] + part).reshape(values.shape)

    def parameter(self, s: ArrayLike) -> Array:
        """Parameter at arc length s (metres), shape of s."""
        values = np.asarray(s, dtype=float)
        slack = 1e-12 * self.total
        if not ((values >= -slack) & (values <= self.total + slack)).all():
            raise StageError(
                f'an arc length lies outside [0, {self.total}] m: clip it to the curve'
            )
        blocks = np.split(values.ravel(), np.arange(_BLOCK, values.size, _BLOCK))
        return np.concatenate([self._inverse(block) for block in blocks]).reshape(values.shape)

    def _inverse(self, wanted: Array) -> Array:
        """Parameters (n,) at arc lengths (n,), by Newton steps kept in a shrinking bracket.

        The bracket holds the iteration where the speed vanishes, as at the cusps of a cycloid.
        """
        tiny = np.finfo(float).tiny
        cell = _cells(self.lengths, wanted)
        start, low, high = (self.parameters[k].copy() for k in (cell, cell, cell + 1))
        left = wanted - self.lengths[cell]
        share = left / np.maximum(np.diff(self.lengths)[cell], tiny)
        u = low + (high - low) * np.clip(share, 0.0, 1.0)
        for _ in range(_BISECTIONS):
            miss = _integral(self.curve, start, u) - left
            unsettled = np.abs(miss) > 4.0 * np.finfo(float).eps * self.total
            if not unsettled.any():
                break
            high = np.where(miss > 0.0, u, high)
            low = np.where(miss > 0.0, low, u)
            step = u - miss / np.maximum(_speed(self.curve, u), tiny)
            inside = (step > low) & (step < high)
            u = np.where(unsettled, np.where(inside, step, 0.5 * (low + high)), u)
        return u

    def feed(self, speed: float, period: float) -> tuple[Array, Array]:
        """Set-points at a constant feed.

        Parameters
        ----------
        speed : feed along the curve, m/s. period : time between set-points, s.

        Returns
        -------
        times : (m,) s. parameters : (m,), the last one at the end of the curve.
        """
        if not (speed > 0.0 and period > 0.0):
            raise StageError(f'feed {speed} m/s and period {period} s must be positive')
        # A whole number of steps, to rounding, needs no further one.
        count = int(np.ceil(self.total / (speed * period) - 1e-9))
        times = np.arange(count + 1, dtype=np.float64) * period
        return times, self.parameter(np.minimum(speed * times, self.total))
