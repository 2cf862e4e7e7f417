"""Gaussian interval type-2 antecedents: centre, lower and upper width per rule and input."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stage_core.arrays import Array

LOWEST_EXPONENT = -60.0
"""Firing strengths are kept above exp(-60) of the strongest rule of the same point.

Far from all rules every strength underflows and eqs. 6-9 of paper 1 would divide zero by zero;
with the floor the rules share such a point instead.
"""

CENTRE_BOUND = 1.3
LOG_WIDTH_BOUNDS = (np.log(0.1), np.log(4.0))
LOG_RATIO_BOUNDS = (np.log(0.2), 0.0)


@dataclass(frozen=True)
class AntecedentSets:
    """Antecedents of M rules over n inputs that are scaled to about [-1, 1].

    Attributes
    ----------
    centres
        (M, n).
    upper, lower
        Widths of the upper and lower membership function, (M, n), lower <= upper.
    """

    centres: Array
    upper: Array
    lower: Array

    @classmethod
    def from_vector(cls, vector: Array, rules: int, inputs: int) -> AntecedentSets:
        """Decode a particle: centres, log upper widths, log(lower/upper), each (M·n,).

        Logarithms keep the widths positive and the lower one below the upper one for every
        particle, which eq. 22 of paper 1 needs and does not ensure.
        """
        centres, log_width, log_ratio = np.asarray(vector, float).reshape(3, rules, inputs)
        upper = np.exp(log_width)
        return cls(centres, upper, upper * np.exp(np.minimum(log_ratio, 0.0)))

    def firing(self, inputs: Array) -> tuple[Array, Array]:
        """Lower and upper firing strength with the product t-norm, (N, M) each.

        Eqs. 22 and 23 of paper 1 (whose Gaussian has no 1/2), divided by the strongest upper
        strength of each point: type reduction only uses ratios.
        """
        difference = (inputs[:, None, :] - self.centres[None]) ** 2
        upper = -(difference / self.upper**2).sum(axis=2)
        lower = -(difference / self.lower**2).sum(axis=2)
        strongest = upper.max(axis=1, keepdims=True)
        upper = np.exp(np.maximum(upper - strongest, LOWEST_EXPONENT))
        return np.exp(np.maximum(lower - strongest, LOWEST_EXPONENT)), upper


def vector_bounds(rules: int, inputs: int) -> tuple[Array, Array]:
    """Box of the swarm, two vectors of length 3·M·n."""
    size = rules * inputs
    low = np.repeat([-CENTRE_BOUND, LOG_WIDTH_BOUNDS[0], LOG_RATIO_BOUNDS[0]], size)
    high = np.repeat([CENTRE_BOUND, LOG_WIDTH_BOUNDS[1], LOG_RATIO_BOUNDS[1]], size)
    return low, high
