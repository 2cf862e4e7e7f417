"""How far two candidates are apart on a motion, beyond what their parameters could make up for.

Of the difference of two predictions only that counts which no choice of parameters within their
intervals takes back (Buzzi-Ferraris and Forzatti, Chemical Engineering Science 38, 1983, where
the difference is weighed by the covariance of the predictions). The draws of the parameters give
that covariance; a ridge over them is its inverse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gap_diagnosis.selection.parts import SERVO_RULES
from stage_core.arrays import Array

#: What a selection asks before it prefers one of two effects (`rivals.find_rivals`): a share of
#: the noise's mean square and one of what the effects explain, those of the force balance.
OF_NOISE, OF_GAP = SERVO_RULES.of_noise, SERVO_RULES.of_gap


@dataclass(frozen=True)
class Predicted:
    """Predictions of one candidate, each (c, m) over the floors.

    Attributes
    ----------
    mean : with the parameters as they were found
    draws : (k, c, m) with parameters drawn from their intervals
    """

    mean: Array
    draws: Array

    @property
    def spread(self) -> Array:
        """Deviations (c * m, k) of the draws, such that their Gram matrix is the covariance."""
        if not len(self.draws):
            return np.zeros((self.mean.size, 0))
        flat = apart(self.draws, self.mean).reshape(len(self.draws), -1)
        return np.asarray(flat.T / np.sqrt(len(flat)))


def apart(one: Array, two: Array) -> Array:
    """Difference of predictions where both move: a channel is zero where its axis rests."""
    return np.asarray((one - two) * ((one != 0.0) & (two != 0.0)))


def margin(one: Predicted, two: Predicted, common: Array) -> float:
    """How far two candidates are apart, over what a selection asks for; above 1 it decides.

    `common` (c, m) is the prediction without what they explain: their gain is measured from it.
    """
    return _margin(apart(one.mean, two.mean), one, two, common)


def decided(one: Predicted, two: Predicted, common: Array) -> float:
    """Share of the pairs of draws whose margin is above 1."""
    pairs = [(a, b) for a in (one.mean, *one.draws) for b in (two.mean, *two.draws)]
    return float(np.mean([_margin(apart(a, b), one, two, common) > 1.0 for a, b in pairs]))


def _margin(difference: Array, one: Predicted, two: Predicted, common: Array) -> float:
    spread = np.hstack([one.spread, two.spread])
    left = difference.reshape(-1)
    if spread.shape[1]:
        gram = spread.T @ spread + np.eye(spread.shape[1])
        left = left - spread @ np.linalg.solve(gram, spread.T @ left)
    remaining = np.mean(left.reshape(difference.shape) ** 2, axis=1)
    gains = [np.mean((p.mean - common) ** 2, axis=1) for p in (one, two)]
    asked = OF_NOISE + OF_GAP * np.minimum(*gains)
    return float(np.max(remaining / asked))


def squashed(margins: Array) -> Array:
    """Margins as shares: half where they just decide, 1 where they are infinite.

    The slope goes on on both sides of 1: where nothing decides, the motion that comes closest is
    the best one.
    """
    return np.asarray(1.0 - 1.0 / (1.0 + margins))
