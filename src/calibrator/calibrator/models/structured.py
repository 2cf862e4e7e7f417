"""The stage's physics as regressors: scale, squareness, straightness, lead screw, backlash, heat.

The default method: on the effects that a screw stage has it beats every black box
(docs/results/calibration.md), its parameters have units and standard deviations, and it
extrapolates as the physics does.
"""

from __future__ import annotations

from math import comb
from typing import Any

import numpy as np

from calibrator.models.adaptable import Adaptable
from calibrator.models.inputs import scaling_of
from calibrator.models.linear import legendre_products
from calibrator.places import Labels, distinct_places, judged_places
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.quantities import AXES

SIGNIFICANCE = 1e-6
"""Probability of a period in noise up to which one is taken for the screw's."""


class Structured(Adaptable):
    """Linear regression of each axis' error on the causes that a screw stage has.

    Regressors of output axis a, with u the command scaled to [-1, 1]:

    - products of Legendre polynomials of u up to `degree` (a number, or `auto`: per axis the
      one with the smallest error at places left out, harmonics included or not likewise): offset,
      scale and squareness (degree one), straightness and pitch error (higher degrees in one
      axis), angular error (mixed);
    - sin and cos of 2π h u_a / lead_a for each harmonic h in `harmonics`, where `lead` is given
      or found (`lead: 'search'`, see :func:`find_period`);
    - the direction of approach of axis a, halved: its coefficient is the width of the backlash;
    - with temperatures: each one's change from its mean, alone and times u_a (growth).

    The least squares is solved on unit-length columns with a ridge of `ridge` (relative to one
    sample's worth of a column), which only matters for columns that the data cannot tell apart.
    """

    method = 'structured'
    weights_key = 'coefficients'
    thermal = True
    summary = 'stage physics by least squares'
    defaults = {'degree': 'auto', 'lead': 'search', 'harmonics': [1, 2], 'ridge': 1e-9}

    def parameter_count(self, axes: int, sensors: int) -> int:
        """Polynomial terms, reversal and thermal terms; harmonics where their number is given."""
        if self.options['degree'] == 'auto':
            # Degree zero is tried too, but no place is known by fewer than an affine map.
            return axes + 1 + 2 * sensors
        count = comb(axes + min(self._degrees()), axes) + 1 + 2 * sensors
        return count + 2 * len(self.options['harmonics'])

    def _fit(self, command: Array, error: Array, direction: Array, temperatures: Array) -> None:
        centre, half = scaling_of(command)
        self.state = {
            'centre': centre,
            'half': half,
            'temperature': temperatures.mean(axis=0) if self.sensors else np.empty(0),
            'reversal': (np.ptp(direction, axis=0) > 0.0).astype(int),
            'leads': np.zeros(self.axes),
            # The period is searched beside a cubic: enough to flatten what a period is not.
            'degrees': np.full(self.axes, min(3, max(self._degrees()))),
        }
        leads = self._given_leads()
        coefficients, deviations, sigmas = [], [], []
        for axis in range(self.axes):
            target = error[:, axis]
            if leads is None:
                design = self._design(command, direction, temperatures, axis)
                self.state['leads'][axis] = find_period(command[:, axis], target, design)
            else:
                self.state['leads'][axis] = leads[axis]
            self._choose_degree(command, target, direction, temperatures, axis)
            design = self._design(command, direction, temperatures, axis)
            if len(design) <= design.shape[1]:
                raise StageError(
                    f'{design.shape[1]} parameters but {len(design)} samples: record more '
                    'positions or lower the option degree'
                )
            solution, covariance = _solve(design, target, self._ridge())
            residual = target - design @ solution
            sigma = float(np.sqrt(residual @ residual / (len(design) - design.shape[1])))
            coefficients.append(solution)
            deviations.append(sigma * np.sqrt(covariance))
            sigmas.append(sigma)
        self.state['coefficients'] = coefficients
        self.state['deviations'] = deviations
        self.state['sigma'] = np.array(sigmas)

    def _linear_design(self, command: Array, d: Array, t: Array) -> list[tuple[Array, Array]]:
        nothing = np.zeros(len(command))
        return [(self._design(command, d, t, axis), nothing) for axis in range(self.axes)]

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
            f'{self.method}: {self.summary}, degrees {self.state["degrees"].tolist()}, screw '
            f'periods {leads}, {count} parameters'
        )

    def _choose_degree(
        self, command: Array, target: Array, direction: Array, temperatures: Array, axis: int
    ) -> None:
        """Degree, and harmonics or none, with the smallest error at places left out."""
        lead = float(self.state['leads'][axis])
        degrees = self._degrees()
        if len(degrees) == 1:
            self.state['degrees'][axis] = degrees[0]
            return
        best = (np.inf, degrees[0], 0.0)
        groups = [judged_places(command), *self.sessions]
        places = int(distinct_places(command).max()) + 1
        for candidate in (0.0, lead) if lead else (0.0,):
            for degree in degrees:
                self.state['leads'][axis], self.state['degrees'][axis] = candidate, degree
                design = self._design(command, direction, temperatures, axis)
                of_place = design.shape[1] - int(self.state['reversal'][axis])
                if places < 1.2 * of_place or len(design) <= 1.2 * design.shape[1]:
                    continue
                left = np.sqrt(
                    np.mean([_left_out(design, target, self._ridge(), g) for g in groups])
                )
                # More terms have to earn their place: leaving out alone keeps a few too many.
                if left < 0.97 * best[0]:
                    best = (left, degree, candidate)
        self.state['degrees'][axis], self.state['leads'][axis] = best[1], best[2]

    def _degrees(self) -> list[int]:
        degree = self.options['degree']
        return list(range(8)) if degree == 'auto' else [int(degree)]

    def _ridge(self) -> float:
        return float(self.options['ridge'])

    def _given_leads(self) -> Array | None:
        lead = self.options['lead']
        if lead == 'search':
            return None
        leads = np.zeros(self.axes) if lead is None else np.asarray(lead, dtype=float)
        return np.broadcast_to(leads, (self.axes,))

    def _design(self, command: Array, direction: Array, temperatures: Array, axis: int) -> Array:
        scaled = (command - self.state['centre']) / self.state['half']
        columns = [legendre_products(scaled, int(self.state['degrees'][axis]))[0]]
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
        orders = legendre_products(one, int(self.state['degrees'][axis]))[1]
        names = ['·'.join(f'P{p}({AXES[a]})' for a, p in enumerate(o) if p) or '1' for o in orders]
        if self.state['leads'][axis] > 0.0:
            for harmonic in self.options['harmonics']:
                names += [f'sin {harmonic}/lead', f'cos {harmonic}/lead']
        if self.state['reversal'][axis]:
            names.append('reversal width')
        names += [f'T{sensor}' for sensor in range(self.sensors)]
        names += [f'T{sensor}·{AXES[axis]}' for sensor in range(self.sensors)]
        return names


def find_period(position: Array, error: Array, design: Array) -> float:
    """Period [m] of the strongest sine of an error over position; 0 where none is significant.

    The screw's error repeats with its lead. A least-squares periodogram, with the other
    regressors fitted along, is scanned from half the travel down to twice the mean spacing
    of the distinct positions, refined, and accepted when the F test of the two extra parameters
    stays below `SIGNIFICANCE` divided by the number of scanned frequencies.

    Parameters
    ----------
    position, error
        Shape (n,) [m].
    design
        The other regressors, (n, p).
    """
    span = float(np.ptp(position))
    distinct = len(np.unique(np.round(position / (span * 1e-7))))
    highest = min(distinct / 2.0, 400.0)
    freedom = len(position) - design.shape[1] - 2
    if freedom < 5 or highest <= 2.0:
        return 0.0
    basis = np.linalg.qr(design)[0]
    rest = error - basis @ (basis.T @ error)

    def unexplained(frequency: float) -> float:
        phase = 2.0 * np.pi * frequency * position
        pair = np.column_stack([np.sin(phase), np.cos(phase)])
        pair -= basis @ (basis.T @ pair)
        (ss, sc), (_, cc) = pair.T @ pair
        rs, rc = rest @ pair
        determinant = ss * cc - sc * sc
        if determinant <= 1e-6 * len(position) ** 2:
            # The regressors at hand already make up this sine, or the positions alias it.
            return 1.0
        gain = (rs * rs * cc - 2.0 * rs * rc * sc + rc * rc * ss) / determinant
        return 1.0 - gain / total

    total = float(rest @ rest)
    if total <= 0.0:
        return 0.0
    # Only here: it takes a quarter of a second to import.
    from scipy.optimize import minimize_scalar

    # Four points per resolution cell keep the peak's loss below five per cent.
    frequencies = np.arange(2.0, highest, 0.25) / span
    left = np.array([unexplained(frequency) for frequency in frequencies])
    best = float(frequencies[int(np.argmin(left))])
    width = 0.25 / span
    found = minimize_scalar(unexplained, bounds=(best - width, best + width), method='bounded')
    # Under noise left^(freedom/2) is the probability of so little left.
    logarithm = 0.5 * freedom * np.log(max(float(found.fun), 1e-300))
    if logarithm > np.log(SIGNIFICANCE / len(frequencies)):
        return 0.0
    return float(1.0 / found.x)


def _solve(design: Array, target: Array, ridge: float) -> tuple[Array, Array]:
    """Ridge solution (p,) and the diagonal (p,) of the inverse normal matrix."""
    length = np.sqrt(np.mean(design**2, axis=0))
    length[length == 0.0] = 1.0
    u, s, vt = np.linalg.svd(design / length, full_matrices=False)
    damped = s / (s**2 + ridge)
    solution = (vt.T @ (damped * (u.T @ target))) / length
    inverse_diagonal = np.sum((vt.T * damped) ** 2, axis=1) / length**2
    return solution, inverse_diagonal


def _left_out(design: Array, target: Array, ridge: float, labels: Labels) -> float:
    """Mean square error of the ridge solution at each label's rows, fitted without them.

    In the basis U of the design's columns, with N = 1 + ridge / s^2, the rows g of a label leave
    (1 - U_g U_g' / N)^-1 (y_g - U_g U'y / N), or y_g - U_g v with v of (N - U_g'U_g) v =
    U'y - U_g'y_g: whichever has fewer unknowns.
    """
    length = np.sqrt(np.mean(design**2, axis=0))
    length[length == 0.0] = 1.0
    u, s, _ = np.linalg.svd(design / length, full_matrices=False)
    # A place that alone carries a term leaves nothing to know it by: its share is then zero.
    normal = 1.0 + 1e-6 + ridge / np.maximum(s**2, 1e-300)
    right, count = u.T @ target, np.bincount(labels)
    order, last = np.argsort(labels, kind='stable'), np.cumsum(count)
    if count.max() > u.shape[1]:
        total = 0.0
        for rows in np.split(order, last[:-1]):
            own = u[rows]
            reduced = np.diag(normal) - own.T @ own
            without = np.linalg.solve(reduced, right - own.T @ target[rows])
            total += float(np.sum((target[rows] - own @ without) ** 2))
        return total / len(target)
    # All labels at once: rows of zeros make them equally many.
    label = labels[order]
    place = np.arange(len(order)) - (last - count)[label]
    owns = np.zeros((len(count), count.max(), u.shape[1]))
    left = np.zeros((len(count), count.max(), 1))
    owns[label, place] = u[order]
    left[label, place, 0] = (target - u @ (right / normal))[order]
    shares = np.eye(count.max()) - (owns / normal) @ owns.swapaxes(1, 2)
    return float(np.sum(np.linalg.solve(shares, left) ** 2)) / len(target)
