"""Arc length of a curve, and a table of the path for the real-time kernels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import make_interp_spline

from contour_ctrl.curves import Curve

FloatArray = NDArray[np.float64]

#: Arc lengths that are inverted together: what they need stays in the processor's cache.
_BLOCK = 4096

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)


class ArcLength:
    """Arc length s(u) of a curve and its inverse.

    Six-point Gauss-Legendre quadrature in about `cells` cells that never straddle a knot;
    the inverse is the table's cell, then Newton on s(u) - s with the same quadrature.
    """

    def __init__(self, curve: Curve, cells: int = 512) -> None:
        self.curve = curve
        breaks = np.asarray(curve.breaks, dtype=float)
        span = np.diff(breaks)
        counts = np.maximum(np.ceil(cells * span / span.sum()).astype(int), 4)
        edges = [
            np.linspace(breaks[i], breaks[i + 1], counts[i] + 1)[:-1] for i in range(len(span))
        ]
        self.parameter = np.concatenate([*edges, breaks[-1:]])
        lengths = self._integral(self.parameter[:-1], self.parameter[1:])
        self.arc = np.concatenate([[0.0], np.cumsum(lengths)])

    @property
    def length(self) -> float:
        """Length of the whole curve [m]."""
        return float(self.arc[-1])

    def parameter_at(self, arc: ArrayLike, steps: int = 4) -> FloatArray:
        """Return the parameter (n,) at arc lengths (n,) [m]."""
        s = np.clip(np.atleast_1d(np.asarray(arc, dtype=float)), 0.0, self.length)
        if len(s) > _BLOCK:
            parts = np.split(s, np.arange(_BLOCK, len(s), _BLOCK))
            return np.concatenate([self.parameter_at(part, steps) for part in parts])
        cell = np.clip(np.searchsorted(self.arc, s, side='right') - 1, 0, len(self.arc) - 2)
        low, high = self.parameter[cell], self.parameter[cell + 1]
        share = (s - self.arc[cell]) / (self.arc[cell + 1] - self.arc[cell])
        u = low + share * (high - low)
        for _ in range(steps):
            residual = self._integral(low, u) - (s - self.arc[cell])
            speed = np.linalg.norm(self.curve.derivatives(u, 1)[1], axis=1)
            u = np.clip(u - residual / speed, low, high)
        return u

    def _integral(self, start: FloatArray, stop: FloatArray) -> FloatArray:
        half = 0.5 * (stop - start)
        u = (0.5 * (start + stop))[:, None] + half[:, None] * _NODES
        speed = np.linalg.norm(self.curve.derivatives(u.ravel(), 1)[1], axis=1)
        return half * (speed.reshape(u.shape) @ _WEIGHTS)


@dataclass(frozen=True)
class PathTable:
    """Points, first and second derivatives of a path on a uniform grid of its parameter.

    Between grid points the kernels use the quintic Hermite polynomial, so a look-up costs the
    same everywhere on every curve. The parameter is the arc length [m] of the planned curve.

    Attributes
    ----------
    step
        Grid spacing [m].
    values
        (m, 6): x, y, x', y', x'', y''.
    closed
        Whether the path runs on from its end to its start.
    """

    step: float
    values: FloatArray
    closed: bool

    @property
    def length(self) -> float:
        """Range of the parameter [m]."""
        return self.step * (len(self.values) - 1)

    @staticmethod
    def from_curve(arc: ArcLength, points: int = 4096) -> PathTable:
        """Sample a curve by its arc length."""
        s = np.linspace(0.0, arc.length, points + 1)
        position, tangent, bend = arc_derivatives(arc.curve, arc.parameter_at(s))
        return PathTable(
            float(s[1]), np.column_stack([position, tangent, bend]), bool(arc.curve.closed)
        )

    @staticmethod
    def from_points(points: FloatArray, length: float, closed: bool) -> PathTable:
        """Make a table from (m, 2) points that are equally spaced in the parameter."""
        step = length / (len(points) - 1)
        return PathTable(step, np.column_stack(sampled_derivatives(points, step)), closed)


def sampled_derivatives(values: FloatArray, step: float) -> tuple[FloatArray, ...]:
    """Return values, first and second derivative, (n, 2) each, of equally spaced samples.

    They come from the quintic spline through the samples.
    """
    grid = step * np.arange(len(values))
    spline = make_interp_spline(grid, values, k=5)
    return values, spline(grid, 1), spline(grid, 2)


def arc_derivatives(
    curve: Curve, parameter: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return point, unit tangent and curvature vector dT/ds, (n, 2) each."""
    position, first, second = curve.derivatives(parameter, 2)
    speed = np.linalg.norm(first, axis=1, keepdims=True)
    tangent = first / speed
    along = np.sum(second * tangent, axis=1, keepdims=True)
    return position, tangent, (second - along * tangent) / speed**2
