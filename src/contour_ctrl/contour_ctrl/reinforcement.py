"""Fuzzy reinforcement regulator of the learning rate (eqs. 12-16, table 1 of paper 3).

The printed equations freeze the learning: a falling error has a negative difference, which
table 1 clips to ZE, and ZE gives a rate of zero. The recommended reading takes the newest
improvement max(0, -de) as the first input, accumulates the reward within [0, 1], and keeps
the rate above a floor. The literal reading stays selectable.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from stage_core.errors import StageError

READINGS = ('recommended', 'literal')

#: Centres of ZE, PS, PM, PB on [0, 1], of the inputs' triangles and of the output (eq. 15).
CENTRES = np.array([0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0])

#: Table 1: row = reward ZE..PB, column = de ZE..PB, entry = index of the output's centre.
RULES = np.array([[0, 0, 0, 0], [0, 1, 1, 2], [0, 1, 2, 3], [0, 2, 3, 3]])


def memberships(value: float) -> np.ndarray:
    """Return the (4,) memberships of ZE, PS, PM, PB: triangles of a third, open at the ends."""
    clipped = min(max(value, 0.0), 1.0)
    return np.maximum(1.0 - 3.0 * np.abs(clipped - CENTRES), 0.0)


def defuzzified(change: float, reward: float) -> float:
    """Return the output of table 1 by the weighted average of singletons (eq. 15)."""
    firing = np.outer(memberships(reward), memberships(change))
    return float(np.sum(firing * CENTRES[RULES]) / np.sum(firing))


#: As shares of the first RMS error: the improvement that counts as PB (s_e), e_limit of eq. 14.
CHANGE_SCALE, LIMIT = 0.1, 0.01
#: K_et of eq. 14, per first RMS error.
REWARD_GAIN = 5.0


@dataclass
class LearningRate:
    """The factor on the initial learning rate of one axis, from iteration to iteration.

    Attributes
    ----------
    reading
        One of `READINGS`.
    floor
        Smallest factor (recommended reading only): without it learning dies.
    """

    reading: str = 'recommended'
    floor: float = 0.2
    reward: float = field(default=1.0, init=False)
    factor: float = field(default=1.0, init=False)
    history: list[float] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        if self.reading not in READINGS:
            raise StageError(f'the reading {self.reading!r} is unknown: one of {READINGS}')
        if not 0.0 < self.floor <= 1.0:
            raise StageError(f'rilc_floor must be above 0 and at most 1, not {self.floor}')

    def after(self, rms: float) -> float:
        """Take the RMS error of the newest iteration; return the factor for learning from it.

        The first iteration learns at the full rate; its error scales everything after it.
        """
        self.history.append(rms)
        if self.reading == 'literal':
            return self._literal()
        if len(self.history) < 2:
            return self.factor
        first = max(self.history[0], 1e-12)
        change = (self.history[-1] - self.history[-2]) / first
        if change >= LIMIT:
            # Eq. 14: no reward. Little is learned from an iteration that was disturbed.
            self.reward, self.factor = 0.0, self.floor
            return self.factor
        # A reward that fell to zero is earned back: eq. 14 with the newest difference.
        self.reward = min(max(self.reward - REWARD_GAIN * change, 0.0), 1.0)
        improvement = max(0.0, -change) / CHANGE_SCALE
        self.factor = max(defuzzified(improvement, self.reward), self.floor)
        return self.factor

    def _literal(self) -> float:
        """Eqs. 12, 14-16 as printed: de of the two iterations before, no floor."""
        if len(self.history) < 3:
            return self.factor
        first = max(self.history[0], 1e-12)
        change = (self.history[-2] - self.history[-3]) / first
        if change >= LIMIT:
            self.reward = 0.0
        else:
            self.reward = min(max(self.reward - REWARD_GAIN * change, 0.0), 1.0)
        self.factor = defuzzified(change / CHANGE_SCALE, self.reward)
        return self.factor
