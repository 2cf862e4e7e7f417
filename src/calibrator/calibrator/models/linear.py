"""Identity, affine (eq. 24 of paper 1) and polynomial maps."""

from __future__ import annotations

from math import comb

import numpy as np

from calibrator.models.adaptable import Adaptable
from calibrator.models.base import CalibrationModel
from calibrator.models.inputs import scaling_of
from calibrator.thermal import monomials
from stage_core.arrays import Array
from stage_core.errors import StageError


class Identity(CalibrationModel):
    """The uncalibrated stage: the table is where the command says."""

    method = 'identity'
    summary = 'no correction'

    def _fit(self, command: Array, error: Array, direction: Array, temperatures: Array) -> None:
        """Learn nothing."""

    def _error(self, command: Array, direction: Array, temperatures: Array) -> Array:
        return np.zeros_like(command)

    def error(self, command: Array, direction: Array, temperatures: Array) -> Array:
        """Zero everywhere: nothing fades to an affine part."""
        return self._error(command, direction, temperatures)


class Affine(Adaptable):
    """measured = Tr · [command; 1], Tr of shape (axes, axes + 1): eq. 24 of paper 1."""

    method = 'affine'
    summary = 'least-squares affine map (eq. 24 of paper 1)'

    def parameter_count(self, axes: int, sensors: int) -> int:
        """One gain per axis and an offset."""
        return axes + 1

    def _fit(self, command: Array, error: Array, direction: Array, temperatures: Array) -> None:
        centre, half = scaling_of(command)
        design = np.column_stack([np.ones(len(command)), (command - centre) / half])
        solution, _, rank, _ = np.linalg.lstsq(design, error, rcond=None)
        if rank < design.shape[1]:
            raise StageError(
                'the positions lie on one line, which leaves the affine map open: record '
                'positions that spread over the travel'
            )
        gain = solution[1:] / half[:, None]
        self.state = {'offset': solution[0] - centre @ gain, 'gain': gain}

    def linear_weights(self) -> list[Array]:
        """Offset and gains per axis."""
        self._require_fitted()
        return list(np.vstack([self.state['offset'], self.state['gain']]).T)

    def set_linear_weights(self, weights: list[Array]) -> None:
        """Replace offset and gains."""
        table = np.array(weights).T
        self.state = {'offset': table[0], 'gain': table[1:]}

    def _linear_design(self, command: Array, d: Array, t: Array) -> list[tuple[Array, Array]]:
        design = np.column_stack([np.ones(len(command)), command])
        return [(design, np.zeros(len(command)))] * self.axes


class Polynomial(CalibrationModel):
    """Full polynomial of a total degree in all axes, least squares on scaled inputs."""

    method = 'polynomial'
    summary = 'polynomial in all axes by least squares'
    defaults = {'degree': 'auto'}
    choices = {'degree': range(1, 8)}

    def parameter_count(self, axes: int, sensors: int) -> int:
        """Number of monomials up to the degree."""
        return comb(axes + self._degree(), axes)

    def _degree(self) -> int:
        degree = self.setting('degree')
        return 1 if degree == 'auto' else int(degree)

    def _fit(self, command: Array, error: Array, direction: Array, temperatures: Array) -> None:
        centre, half = scaling_of(command)
        design = legendre_products((command - centre) / half, self._degree())[0]
        coefficients = np.linalg.lstsq(design, error, rcond=None)[0]
        self.state = {'centre': centre, 'half': half, 'coefficients': coefficients}

    def _error(self, command: Array, direction: Array, temperatures: Array) -> Array:
        scaled = (command - self.state['centre']) / self.state['half']
        return legendre_products(scaled, self._degree())[0] @ (self.state['coefficients'])

    def describe(self) -> str:
        """The summary with the degree."""
        return f'{self.method}: {self.summary}, degree {self.setting("degree")}'


def legendre_products(scaled: Array, degree: int) -> tuple[Array, list[tuple[int, ...]]]:
    """Products of Legendre polynomials up to a total degree.

    Parameters
    ----------
    scaled
        Inputs in [-1, 1], shape (n, axes). Legendre polynomials keep the least squares well
        conditioned where monomials of degree 7 no longer are.
    degree
        Highest total degree.

    Returns
    -------
    values, orders
        (n, terms) and the order per axis of each term; the first is the constant.
    """
    axes = scaled.shape[1]
    single = [np.polynomial.legendre.legvander(scaled[:, axis], degree) for axis in range(axes)]
    orders = [(0,) * axes, *monomials(axes, degree)]
    values = np.ones((len(scaled), len(orders)))
    for term, order in enumerate(orders):
        for axis, power in enumerate(order):
            if power:
                values[:, term] *= single[axis][:, power]
    return values, orders
