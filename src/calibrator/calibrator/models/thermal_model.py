"""Thermal calibration of paper 2: stepwise regression on geometric and thermal terms per axis."""

from __future__ import annotations

from typing import Any

import numpy as np

from calibrator.models.base import CalibrationModel
from calibrator.models.inputs import scaling_of
from calibrator.stepwise import stepwise
from calibrator.thermal import SETS, thermal_terms, up_to
from stage_core.arrays import Array


class Thermal(CalibrationModel):
    """Eq. 4 of paper 2 per axis, terms selected by p-value; inverted by Newton-Raphson.

    The temperature columns are as the caller gives them: readings, and with the option
    `derivatives` their first and then their second derivatives as two further thirds of the
    columns of `temperatures`. `training.train` sets it where a session is long enough for them.
    """

    method = 'thermal'
    summary = 'stepwise regression on geometric and thermal terms (paper 2)'
    defaults = {'enter': 0.05, 'remove': 0.10, 'terms': 'auto', 'derivatives': False}
    thermal = True

    def candidates(self) -> list[dict[str, Any]]:
        """Sets of candidate terms, of the paper's section V.B."""
        if self.options['terms'] != 'auto':
            return [{}]
        return [{'terms': terms} for terms in SETS[1 if self.options['derivatives'] else 0 :]]

    def parameter_count(self, axes: int, sensors: int) -> int:
        """First-order terms: what a selection will hold at least."""
        return axes + 1

    def _fit(self, command: Array, error: Array, direction: Array, temperatures: Array) -> None:
        centre, half = scaling_of(command)
        count = self._readings()
        self.state = {
            'centre': centre,
            'half': half,
            'reference': temperatures[:, :count].mean(axis=0),
        }
        columns = self._columns(command, temperatures)
        fits = [
            stepwise(
                columns,
                error[:, axis],
                float(self.options['enter']),
                float(self.options['remove']),
            )
            for axis in range(self.axes)
        ]
        self.state['coefficients'] = np.array([fit.coefficients for fit in fits])
        self.state['intercept'] = np.array([fit.intercept for fit in fits])
        self.state['sigma'] = np.array([fit.sigma for fit in fits])

    def _error(self, command: Array, direction: Array, temperatures: Array) -> Array:
        columns = self._columns(command, temperatures)
        return self.state['intercept'] + columns @ self.state['coefficients'].T

    def describe(self) -> str:
        """Number of selected terms per axis."""
        if not self.fitted:
            return super().describe()
        kept = [int(np.count_nonzero(c)) for c in self.state['coefficients']]
        terms = self.state['coefficients'].shape[1]
        return f'{self.method}: {self.summary}, {kept} of {terms} terms'

    def _readings(self) -> int:
        return self.sensors // 3 if self.options['derivatives'] else self.sensors

    def _columns(self, command: Array, temperatures: Array) -> Array:
        scaled = (command - self.state['centre']) / self.state['half']
        count = self._readings()
        first = second = None
        if self.options['derivatives']:
            first, second = temperatures[:, count : 2 * count], temperatures[:, 2 * count :]
        heat, reference = temperatures[:, :count], self.state['reference']
        terms = thermal_terms(scaled, heat, first, second, reference)
        return up_to(terms, str(self.setting('terms')))
