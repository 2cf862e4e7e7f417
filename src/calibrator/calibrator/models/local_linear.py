"""LOLIMOT (paper 5) as a calibration method: one local linear model tree per axis."""

from __future__ import annotations

import numpy as np

from calibrator.lolimot import LocalLinearTree, grow
from calibrator.models.base import CalibrationModel
from calibrator.models.inputs import scaling_of
from stage_core.arrays import Array


class LocalLinear(CalibrationModel):
    """A tree per output axis over the commanded position, grown until Akaike's criterion rises."""

    method = 'lolimot'
    summary = 'local linear model tree (paper 5)'
    defaults = {'models': 'auto', 'overlap': 0.33, 'split_all': False}
    #: Most local models; Akaike's criterion may stop before.
    choices = {'models': (1, 2, 4, 8, 16, 30)}

    def parameter_count(self, axes: int, sensors: int) -> int:
        """One local model."""
        return axes + 2

    def _fit(self, command: Array, error: Array, direction: Array, temperatures: Array) -> None:
        centre, half = scaling_of(command)
        scale = np.maximum(np.abs(error).max(axis=0), 1e-300)
        self.state = {'centre': centre, 'half': half, 'scale': scale, 'trees': []}
        for axis in range(self.axes):
            tree = grow(
                (command - centre) / half,
                error[:, axis] / scale[axis],
                int(self.setting('models')),
                float(self.options['overlap']),
                bool(self.options['split_all']),
            )[-1]
            self.state['trees'].append(
                {'low': tree.low, 'high': tree.high, 'weights': tree.weights}
            )

    def _error(self, command: Array, direction: Array, temperatures: Array) -> Array:
        inputs = (command - self.state['centre']) / self.state['half']
        overlap = float(self.options['overlap'])
        trees = [LocalLinearTree(overlap=overlap, **tree) for tree in self.state['trees']]
        return np.column_stack([tree.predict(inputs) for tree in trees]) * self.state['scale']

    def describe(self) -> str:
        """Number of local models per axis."""
        if not self.fitted:
            return super().describe()
        counts = [len(tree['low']) for tree in self.state['trees']]
        return f'{self.method}: {self.summary}, {counts} local models'
