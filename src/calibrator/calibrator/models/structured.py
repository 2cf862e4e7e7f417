"""The stage's physics as regressors: scale, squareness, straightness, lead screw, backlash, heat.

The default method: on the effects that a screw stage has it beats every black box (see
docs/calibration.md), its parameters have units and standard deviations, and it extrapolates as
the physics does.
"""

from __future__ import annotations

from math import comb
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from calibrator.models.base import Array, CalibrationModel, scaling_of
from calibrator.models.linear import legendre_products
from stage_core.errors import StageError
from stage_core.quantities import AXES


class Structured(CalibrationModel):
    """Linear regression of each axis' error on the causes that a screw stage has.

    Regressors of output axis a, with u the command scaled to [-1, 1]:

    - products of Legendre polynomials of u up to `degree`: offset, scale and squareness (degree
      one), straightness and pitch error (higher degrees in one axis), angular error (mixed);
    - sin and cos of 2π h u_a / lead_a for each harmonic h in `harmonics`, where `lead` is given
      or found (`lead: 'search'`, see :func:`find_period`);
    - the direction of approach of axis a, halved: its coefficient is the width of the backlash;
    - with temperatures: each one's change from its mean, alone and times u_a (growth).

    The least squares is solved on unit-length columns with a ridge of `ridge` (relative to one
    sample's worth of a column), which only matters for columns that the data cannot tell apart.
    """

    method = 'structured'
    summary = 'stage physics by least squares'
    defaults = {'degree': 5, 'lead': 'search', 'harmonics': [1, 2], 'ridge': 1e-9}

    def parameter_count(self, axes: int, sensors: int) -> int:
        """Polynomial terms, harmonics, reversal and thermal terms."""
        terms = comb(axes + int(self.options['degree']), axes)
        return terms + 2 * len(self.options['harmonics']) + 1 + 2 * sensors

    def _fit(self, command: Array, error: Array, direction: Array, temperatures: Array) -> None:
        centre, half = scaling_of(command)
        self.state = {
            'centre': centre,
            'half': half,
            'temperature': temperatures.mean(axis=0) if self.sensors else np.empty(0),
            'reversal': np.array([_varies(direction[:, a]) for a in range(self.axes)], dtype=int),
            'leads': np.zeros(self.axes),
        }
        leads = self._given_leads()
        coefficients, deviations, sigmas = [], [], []
        for axis in range(self.axes):
            if leads is None:
                plain = self._design(command, direction, temperatures, axis)
                rest = error[:, axis] - plain @ _solve(plain, error[:, axis], self._ridge())[0]
                period = find_period(command[:, axis], rest)
                if period:
                    period = _refined_period(period, command[:, axis], error[:, axis], plain)
                self.state['leads'][axis] = period
            else:
                self.state['leads'][axis] = leads[axis]
            design = self._design(command, direction, temperatures, axis)
            if len(design) <= design.shape[1]:
                raise StageError(
                    f'{design.shape[1]} parameters but {len(design)} samples: record more '
                    'positions or lower the option degree'
                )
            solution, covariance = _solve(design, error[:, axis], self._ridge())
            residual = error[:, axis] - design @ solution
            sigma = float(np.sqrt(residual @ residual / (len(design) - design.shape[1])))
            coefficients.append(solution)
            deviations.append(sigma * np.sqrt(covariance))
            sigmas.append(sigma)
        self.state['coefficients'] = coefficients
        self.state['deviations'] = deviations
        self.state['sigma'] = np.array(sigmas)

    def _error(self, command: Array, direction: Array, temperatures: Array) -> Array:
        return np.column_stack(
            [
                self._design(command, direction, temperatures, axis)
                @ self.state['coefficients'][axis]
                for axis in range(self.axes)
            ]
        )

    def parameters(self) -> list[dict[str, Any]]:
        """Every parameter: output axis, name, value [m] and its standard deviation [m].

        Values belong to the regressors of the class, so each is the size of that error at the
        end of the travel (polynomials), its amplitude (harmonics) or its width (reversal).
        """
        self._require_fitted()
        rows = []
        for axis in range(self.axes):
            for name, value, deviation in zip(
                self._names(axis),
                self.state['coefficients'][axis],
                self.state['deviations'][axis],
                strict=True,
            ):
                rows.append(
                    {
                        'axis': AXES[axis],
                        'name': name,
                        'value': float(value),
                        'std': float(deviation),
                    }
                )
        return rows

    def describe(self) -> str:
        """Degree, leads and number of parameters."""
        if not self.fitted:
            return super().describe()
        leads = ', '.join(
            f'{1e3 * lead:.4g} mm' if lead else 'none' for lead in self.state['leads']
        )
        count = sum(len(c) for c in self.state['coefficients'])
        return (
            f'{self.method}: {self.summary}, degree {self.options["degree"]}, screw periods '
            f'{leads}, {count} parameters'
        )

    def _ridge(self) -> float:
        return float(self.options['ridge'])

    def _given_leads(self) -> Array | None:
        lead = self.options['lead']
        if lead == 'search':
            return None
        leads = np.zeros(self.axes) if lead is None else np.asarray(lead, dtype=float)
        leads = np.broadcast_to(leads, (self.axes,)).copy()
        if not np.isfinite(leads).all() or (leads < 0).any():
            raise StageError('option lead must be a length per axis in m, "search" or null')
        return leads

    def _design(self, command: Array, direction: Array, temperatures: Array, axis: int) -> Array:
        scaled = (command - self.state['centre']) / self.state['half']
        columns = [legendre_products(scaled, int(self.options['degree']))[0]]
        lead = float(self.state['leads'][axis])
        if lead > 0.0:
            phase = 2.0 * np.pi * command[:, axis] / lead
            for harmonic in self.options['harmonics']:
                columns += [np.sin(harmonic * phase)[:, None], np.cos(harmonic * phase)[:, None]]
        if self.state['reversal'][axis]:
            columns.append(direction[:, axis : axis + 1] / 2.0)
        if self.sensors:
            change = temperatures - self.state['temperature']
            columns += [change, change * scaled[:, axis : axis + 1]]
        return np.column_stack(columns)

    def _names(self, axis: int) -> list[str]:
        one = np.zeros((1, self.axes))
        orders = legendre_products(one, int(self.options['degree']))[1]
        names = ['·'.join(f'P{p}({AXES[a]})' for a, p in enumerate(o) if p) or '1' for o in orders]
        if self.state['leads'][axis] > 0.0:
            for harmonic in self.options['harmonics']:
                names += [f'sin {harmonic}/lead', f'cos {harmonic}/lead']
        if self.state['reversal'][axis]:
            names.append('reversal width')
        names += [f'T{sensor}' for sensor in range(self.sensors)]
        names += [f'T{sensor}·{AXES[axis]}' for sensor in range(self.sensors)]
        return names


def find_period(position: Array, residual: Array, significance: float = 1e-6) -> float:
    """Period [m] of the strongest sine of a residual over position; 0 where none is significant.

    The screw's error repeats with its lead. A least-squares periodogram is scanned from a third
    of the travel down to twice the mean spacing of the distinct positions, refined, and accepted
    when the F test of two extra parameters stays below `significance` divided by the number of
    scanned frequencies.

    Parameters
    ----------
    position, residual
        Shape (n,) [m].
    """
    span = float(np.ptp(position))
    distinct = len(np.unique(np.round(position / (span * 1e-7))))
    highest = min(distinct / 2.0, 400.0)
    if len(position) < 30 or highest <= 3.0:
        return 0.0
    rest = residual - residual.mean()
    # Four points per resolution cell keep the peak's loss below five per cent.
    frequencies = np.arange(3.0, highest, 0.25) / span
    power = _sine_power(position, rest, frequencies)
    best = frequencies[int(np.argmax(power))]
    fine = best + np.linspace(-0.25, 0.25, 101) / span
    fine_power = _sine_power(position, rest, fine)
    share = float(fine_power.max())
    # Under noise (1 - share)^((n-3)/2) is the probability of a share at least this large.
    logarithm = 0.5 * (len(rest) - 3) * np.log1p(-min(share, 1.0 - 1e-15))
    if logarithm > np.log(significance / len(frequencies)):
        return 0.0
    return float(1.0 / fine[int(np.argmax(fine_power))])


def _refined_period(period: float, position: Array, error: Array, design: Array) -> float:
    """The period [m] that fits best together with the other regressors, not after them."""
    basis = np.linalg.qr(design)[0]
    rest = error - basis @ (basis.T @ error)

    def unexplained(frequency: float) -> float:
        phase = 2.0 * np.pi * frequency * position
        pair = np.column_stack([np.sin(phase), np.cos(phase)])
        pair -= basis @ (basis.T @ pair)
        left = rest - pair @ np.linalg.lstsq(pair, rest, rcond=None)[0]
        return float(left @ left)

    width = 0.25 / float(np.ptp(position))
    found = minimize_scalar(
        unexplained, bounds=(1.0 / period - width, 1.0 / period + width), method='bounded'
    )
    return float(1.0 / found.x)


def _sine_power(position: Array, residual: Array, frequencies: Array) -> Array:
    """Share of the residual's energy that a sine of each frequency explains, in [0, 1]."""
    total = float(residual @ residual)
    if total <= 0.0:
        return np.zeros(len(frequencies))
    share = np.empty(len(frequencies))
    for i, frequency in enumerate(frequencies):
        phase = 2.0 * np.pi * frequency * position
        s, c = np.sin(phase), np.cos(phase)
        ss, cc, sc = s @ s, c @ c, s @ c
        rs, rc = residual @ s, residual @ c
        determinant = ss * cc - sc * sc
        if determinant <= 1e-9 * ss * cc:
            share[i] = 0.0
            continue
        share[i] = (rs * rs * cc - 2.0 * rs * rc * sc + rc * rc * ss) / determinant / total
    return share


def _solve(design: Array, target: Array, ridge: float) -> tuple[Array, Array]:
    """Ridge solution (p,) and the diagonal (p,) of the inverse normal matrix."""
    length = np.sqrt(np.mean(design**2, axis=0))
    length[length == 0.0] = 1.0
    u, s, vt = np.linalg.svd(design / length, full_matrices=False)
    damped = s / (s**2 + ridge)
    solution = (vt.T @ (damped * (u.T @ target))) / length
    inverse_diagonal = np.sum((vt.T * damped) ** 2, axis=1) / length**2
    return solution, inverse_diagonal


def _varies(direction: Array) -> bool:
    return bool(np.ptp(direction) > 0.0)
