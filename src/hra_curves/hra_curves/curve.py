"""Curves in an fg-Bernstein basis: evaluation and derivatives."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from hra_curves import kernels
from hra_curves.bases import Basis
from stage_core.arrays import Array
from stage_core.errors import StageError


@dataclass(frozen=True)
class HraCurve:
    """Curve sum_j C(n,j) f**j g**(n-j) P_j in the plane (or any dimension).

    Parameters
    ----------
    basis : pair (f, g).
    control_points : (n+1, d), metres.
    domain : parameters of the first and last point as the user counts them (an angle, say),
        mapped linearly onto the domain of the basis; None takes that of the basis.

    Raises
    ------
    StageError
        Control points that are not finite or not a table; an empty domain.
    """

    basis: Basis
    control_points: Array
    domain: tuple[float, float] = field(default=(math.nan, math.nan))

    def __post_init__(self) -> None:
        control = np.ascontiguousarray(self.control_points, dtype=float)
        if control.ndim != 2 or control.shape[0] < 1 or not np.isfinite(control).all():
            raise StageError(
                f'control points of shape {control.shape}: give finite numbers, one row a point'
            )
        object.__setattr__(self, 'control_points', control)
        first, last = self.domain
        if math.isnan(first) and math.isnan(last):
            object.__setattr__(self, 'domain', self.basis.domain)
        elif not (math.isfinite(first) and math.isfinite(last) and first < last):
            raise StageError(f'the domain {self.domain} is empty: give first < last')

    def _basis_parameter(self, u: Array) -> Array:
        first, last = self.domain
        lower, upper = self.basis.domain
        slack = 1e-12 * (last - first)
        if not np.isfinite(u).all() or (u < first - slack).any() or (u > last + slack).any():
            raise StageError(
                f'a curve parameter lies outside [{first}, {last}]: clip it to the domain'
            )
        if self.domain == self.basis.domain:
            mapped = u
        else:
            mapped = lower + (u - first) * ((upper - lower) / (last - first))
        return np.clip(mapped, lower, upper)

    @property
    def breaks(self) -> Array:
        """Parameters where smoothness may drop: only the ends (2,)."""
        return np.array(self.domain)

    @property
    def closed(self) -> bool:
        """Whether the last point is the first one, to 1e-9 of the size of the curve."""
        ends = self.evaluate(np.array(self.domain))
        size = float(np.ptp(self.control_points, axis=0).max())
        return bool(np.linalg.norm(ends[1] - ends[0]) <= 1e-9 * size)

    def derivatives(self, parameter: ArrayLike, order: int) -> Array:
        """Point and derivatives by the parameter, (order + 1, m, d), for (m,) parameters.

        Raises
        ------
        StageError
            A parameter outside the domain or a negative order.
        """
        if order < 0:
            raise StageError(f'derivative order {order} is negative: give 0 or more')
        u = np.atleast_1d(np.asarray(parameter, dtype=float)).ravel()
        f, g = self.basis.taylor(self._basis_parameter(u), order)
        series = np.empty((u.size, order + 1, self.control_points.shape[1]))
        kernels.evaluate_series(
            self.control_points, np.ascontiguousarray(f), np.ascontiguousarray(g), series
        )
        lower, upper = self.basis.domain
        slope = (upper - lower) / (self.domain[1] - self.domain[0])
        scales = np.array([math.factorial(k) * slope**k for k in range(order + 1)])
        return np.moveaxis(series * scales[:, None], 1, 0)

    def evaluate(self, u: ArrayLike) -> Array:
        """Point of the curve, metres: (d,) for a number, (m, d) for an array (m,)."""
        return self.derivatives(u, 0)[0].reshape(np.shape(u) + (-1,))
