"""Methods whose error is linear in weights, which the rests of a running stage can adapt."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from calibrator.models.base import CalibrationModel
from stage_core.arrays import Array


class Adaptable(CalibrationModel):
    """A method whose error is design @ weights + offset per output axis."""

    weights_key: ClassVar[str]
    """Where `state` holds the weights (p,) per output axis."""

    def linear_weights(self) -> list[Array]:
        """Weights (p,) per output axis."""
        self._require_fitted()
        return [np.array(weights) for weights in self.state[self.weights_key]]

    def set_linear_weights(self, weights: list[Array]) -> None:
        """Replace the weights of `linear_weights`."""
        self.state[self.weights_key] = [np.array(w) for w in weights]

    def _error(self, command: Array, direction: Array, temperatures: Array) -> Array:
        designs = self._linear_design(command, direction, temperatures)
        return np.column_stack(
            [
                design @ weights + offset
                for (design, offset), weights in zip(designs, self.linear_weights(), strict=True)
            ]
        )

    @abstractmethod
    def _linear_design(self, command: Array, d: Array, t: Array) -> list[tuple[Array, Array]]:
        """Design (n, p) and offset (n,) per output axis, inside the domain."""

    def linear_design(
        self,
        command: ArrayLike,
        direction: ArrayLike | None = None,
        temperatures: ArrayLike | None = None,
    ) -> list[tuple[Array, Array]]:
        """Design (n, p) and offset (n,) per output axis, faded beyond the domain as `error`."""
        c, d, t = self._of_the_fit(command, direction, temperatures)
        assert self.domain is not None
        held, heat = self.domain.hold(c, t)
        weight = self.domain.weight(held)
        rest = self.domain.guard(lambda h, _: np.zeros_like(h), c, t)
        return [
            (weight[:, None] * design, weight * offset + rest[:, axis])
            for axis, (design, offset) in enumerate(self._linear_design(held, d, heat))
        ]
