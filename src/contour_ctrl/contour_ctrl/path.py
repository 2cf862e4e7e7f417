"""A table of the path for the real-time kernels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from hra_curves.arc_length import ArcLength, Curve
from stage_core.arrays import Array


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
    values: Array
    closed: bool

    @property
    def length(self) -> float:
        """Range of the parameter [m]."""
        return self.step * (len(self.values) - 1)

    @staticmethod
    def from_curve(arc: ArcLength, points: int = 4096) -> PathTable:
        """Sample a curve by its arc length."""
        s = np.linspace(0.0, arc.total, points + 1)
        position, tangent, bend = arc_derivatives(arc.curve, arc.parameter(s))
        return PathTable(
            float(s[1]), np.column_stack([position, tangent, bend]), bool(arc.curve.closed)
        )

    @staticmethod
    def from_points(points: Array, length: float, closed: bool) -> PathTable:
        """Make a table from (m, 2) points that are equally spaced in the parameter."""
        step = length / (len(points) - 1)
        return PathTable(step, np.column_stack(sampled_derivatives(points, step)), closed)


def sampled_derivatives(values: Array, step: float) -> tuple[Array, ...]:
    """Return values, first and second derivative, (n, 2) each, of equally spaced samples.

    They come from the quintic spline through the samples.
    """
    grid = step * np.arange(len(values))
    spline = make_interp_spline(grid, values, k=5)
    return values, spline(grid, 1), spline(grid, 2)


def arc_derivatives(curve: Curve, parameter: Array) -> tuple[Array, Array, Array]:
    """Return point, unit tangent and curvature vector dT/ds, (n, 2) each."""
    position, first, second = curve.derivatives(parameter, 2)
    speed = np.linalg.norm(first, axis=1, keepdims=True)
    tangent = first / speed
    along = np.sum(second * tangent, axis=1, keepdims=True)
    return position, tangent, (second - along * tangent) / speed**2
