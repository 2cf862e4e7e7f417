"""Cerebellar model articulation controller over the velocity command (eqs. 3-5, 19 of paper 3).

N_e layers of square cells, each layer shifted by 1/N_e of a cell; one cell of each layer is
active, so the sum of b in eq. 19 is the N_e of eq. 4.

Two ways to learn. `gradient` (recommended): each active weight takes (rate * Ts * E'(k)) / N_e
and leaks slowly, an integral action that remembers per state. `literal`: eq. 19 as printed
with the increment E'(k-1) - E'(k-2), whose sum telescopes: a constant contour error teaches
nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from stage_core.arrays import Array
from stage_core.errors import StageError

UPDATES = ('gradient', 'literal')


@njit(inline='always')
def _cell(layer: int, layers: int, cells: int, x: float, y: float) -> tuple[int, int]:
    """The active cell of a layer."""
    shift, span = layer / layers, cells - 1e-9
    return int(min(max(x, 0.0), 1.0) * span + shift), int(min(max(y, 0.0), 1.0) * span + shift)


@njit(cache=True)
def output(weights: Array, x: float, y: float) -> float:
    """Return U = sum of the active weights (eq. 3) at the input (x, y), both in [0, 1]."""
    layers, cells = weights.shape[0], weights.shape[1] - 1
    total = 0.0
    for layer in range(layers):
        i, j = _cell(layer, layers, cells, x, y)
        total += weights[layer, i, j]
    return total


@njit(cache=True)
def update(
    weights: Array, x: float, y: float, increment: float, keep: float, limit: float
) -> None:
    """Add `increment` / N_e to each active weight (eqs. 4 and 19), after a leak `keep` <= 1.

    The weights stay within +-`limit` / N_e, so that the output stays within +-`limit`.
    """
    layers, cells = weights.shape[0], weights.shape[1] - 1
    share, bound = increment / layers, limit / layers
    for layer in range(layers):
        i, j = _cell(layer, layers, cells, x, y)
        value = keep * weights[layer, i, j] + share
        weights[layer, i, j] = min(max(value, -bound), bound)


@dataclass(frozen=True)
class CmacSettings:
    """Quantisation and learning of the CMAC; the paper states none of these numbers.

    Attributes
    ----------
    layers
        N_e, cells that are active at once.
    cells
        Cells per layer over the range of one input.
    rate
        Gradient update: 1/s^2 (velocity per contour error and time). Literal: lambda of
        eq. 19, 1/s.
    leak
        Decay of the active weights, 1/s; gradient update only.
    limit
        Largest output [m/s].
    mode
        One of `UPDATES`.
    """

    layers: int = 8
    cells: int = 24
    rate: float = 2000.0
    leak: float = 0.02
    limit: float = 0.02
    mode: str = 'gradient'

    def __post_init__(self) -> None:
        if self.mode not in UPDATES:
            raise StageError(f'the CMAC update {self.mode!r} is unknown: one of {UPDATES}')
        if self.layers < 1 or self.cells < 2:
            raise StageError('the CMAC needs at least 1 layer and 2 cells')
        if not (self.rate >= 0.0 and self.leak >= 0.0 and self.limit > 0.0):
            raise StageError('CMAC rate and leak must not be negative, limit must be positive')

    def empty_weights(self) -> Array:
        """Return zero weights (layers, cells + 1, cells + 1)."""
        return np.zeros((self.layers, self.cells + 1, self.cells + 1))
