"""Arc length of a curve and feed at constant speed along it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stage_core.errors import StageError

Array = NDArray[np.float64]
_GAUSS_POINTS, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(8)
_BISECTIONS = 60


class DifferentiableCurve(Protocol):
    """What arc length asks of a curve; :class:`hra_curves.HraCurve` has it."""

    @property
    def domain(self) -> tuple[float, float]:
        """Interval of the parameter."""

    def evaluate(self, u: ArrayLike) -> Array:
        """Points (m, d)."""

    def derivative(self, u: ArrayLike, order: int = 1) -> Array:
        """Derivatives (m, d)."""


def _speed(curve: DifferentiableCurve, u: Array) -> Array:
    return np.linalg.norm(curve.derivative(u, 1), axis=-1)


def _integrate(speed: Callable[[Array], Array], first: Array, last: Array) -> Array:
    """Gauss-Legendre integral of the speed over each interval, 8 points."""
    half = 0.5 * (last - first)
    u = (0.5 * (first + last))[:, None] + half[:, None] * _GAUSS_POINTS
    return half * (speed(u.ravel()).reshape(u.shape) @ _GAUSS_WEIGHTS)


@dataclass(frozen=True)
class ArcLength:
    """Table of the arc length of a curve, exact to rounding where the curve is smooth.

    Attributes
    ----------
    parameters, lengths : (segments+1,) parameter and length from the start, metres.
    """

    curve: DifferentiableCurve
    parameters: Array
    lengths: Array

    @classmethod
    def of(cls, curve: DifferentiableCurve, segments: int = 256) -> ArcLength:
        """Build the table of a curve over its domain."""
        if segments < 1:
            raise StageError(f'{segments} segments: give at least 1')
        parameters = np.linspace(curve.domain[0], curve.domain[1], segments + 1)
        pieces = _integrate(lambda u: _speed(curve, u), parameters[:-1], parameters[1:])
        return cls(curve, parameters, np.concatenate(([0.0], np.cumsum(pieces))))

    @property
    def total(self) -> float:
        """Length of the whole curve, metres."""
        return float(self.lengths[-1])

    def length(self, u: ArrayLike) -> Array:
        """Arc length from the start to parameter u, metres, shape of u."""
        values = np.asarray(u, dtype=float)
        flat = np.atleast_1d(values).ravel()
        index = np.clip(
            np.searchsorted(self.parameters, flat, side='right') - 1, 0, self.lengths.size - 2
        )
        start = self.parameters[index]
        part = _integrate(lambda v: _speed(self.curve, v), start, flat)
        return (self.lengths[index] + part).reshape(values.shape)

    def parameter(self, s: ArrayLike) -> Array:
        """Parameter at arc length s (metres), by Newton steps kept in a shrinking bracket.

        The bracket holds the iteration where the speed vanishes, as at the cusps of a cycloid.
        """
        values = np.asarray(s, dtype=float)
        wanted = np.atleast_1d(values).ravel()
        slack = 1e-12 * self.total
        if (
            not np.isfinite(wanted).all()
            or wanted.min() < -slack
            or wanted.max() > (self.total + slack)
        ):
            raise StageError(
                f'an arc length lies outside [0, {self.total}] m: clip it to the curve'
            )
        index = np.clip(
            np.searchsorted(self.lengths, wanted, side='right') - 1, 0, self.lengths.size - 2
        )
        low, high = self.parameters[index].copy(), self.parameters[index + 1].copy()
        gap = np.maximum(np.diff(self.lengths)[index], np.finfo(float).tiny)
        u = low + (high - low) * np.clip((wanted - self.lengths[index]) / gap, 0.0, 1.0)
        for _ in range(_BISECTIONS):
            miss = self.length(u) - wanted
            if np.abs(miss).max() <= 4.0 * np.finfo(float).eps * self.total:
                break
            high = np.where(miss > 0.0, u, high)
            low = np.where(miss > 0.0, low, u)
            speed = np.maximum(_speed(self.curve, u), np.finfo(float).tiny)
            step = u - miss / speed
            u = np.where((step > low) & (step < high), step, 0.5 * (low + high))
        return u.reshape(values.shape)

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
