"""Runs the candidates of an experiment on motions, and looks for the best motion of a kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from gap_diagnosis.experiment.library import Library
from gap_diagnosis.experiment.motions import Limits, Motion, boldest, draw, excess, sample
from gap_diagnosis.experiment.prediction import STEP, Predictor
from gap_diagnosis.experiment.questions import Pair
from gap_diagnosis.experiment.separation import Predicted, margin, squashed
from gap_diagnosis.parameters import Effects, Parameters, plain_values
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_twin.effects import effect_of

Runs = tuple[Predicted, Predicted, Array]

PIECE = 6.0  # s, of one motion
#: Motions of each kind that are judged without draws: the boldest, a less bold one, as an engineer
#: would choose, and some at random.
USUAL = (0.9, 0.8)
STARTS = 3
ROUNDS, TRIALS, REACH = 1, 3, 0.15  # the best of a kind is refined: so many moves of that length
DRAWS = 3  # of the parameters of a candidate
SHARE_OF_FORCE = 0.8  # of the limit that a prediction may reach


class Question:
    """A pair with the parameters that are simulated."""

    def __init__(self, pair: Pair, generator: np.random.Generator) -> None:
        self.names = pair.names
        self._sides = _drawn(pair.one, generator), _drawn(pair.two, generator)
        self._common = plain_values(pair.common)

    def run(self, shown: Callable[[Effects], Array], draws: bool) -> Runs:
        """Predictions of both sides and of what both have, from those of any effects."""

        def side(candidate: list[Effects]) -> Predicted:
            first, *others = candidate
            mean = shown(first)
            drawn = [shown(values) for values in others] if draws else []
            return Predicted(mean, np.array(drawn).reshape(-1, *mean.shape))

        return side(self._sides[0]), side(self._sides[1]), shown(self._common)


@dataclass(frozen=True)
class Scene:
    """What is asked of a motion, and what it is judged by.

    Attributes
    ----------
    predictor : runs the twin
    limits : those of a motion
    questions : pairs that the session left open
    library : effects that may be there
    """

    predictor: Predictor
    limits: Limits
    questions: list[Question] = field(default_factory=list)
    library: Library = field(default_factory=Library)

    def shower(self, position: Array, ran: bool = False) -> Callable[[Effects], Array]:
        """Gives the channels (c, m) of a motion with any effects; each is simulated once.

        It raises StageError where something is no machine or, of a motion that has not `ran`
        before, where a force goes too far.
        """
        known: dict[str, Array] = {}

        def shown(effects: Effects) -> Array:
            key = repr(sorted(effects.items()))
            if key not in known:
                known[key], force = self.predictor.channels(effects, position)
                if not ran and np.any(force > SHARE_OF_FORCE * self.limits.force):
                    raise StageError('the force goes too far')
            return known[key]

        return shown

    def tried(self, motion: Motion, draws: bool) -> Tried | None:
        """A motion with its margins; None where it is beyond a limit."""
        period = self.predictor.twin.control_period
        position = sample(motion, self.limits, PIECE, period)
        if excess(position, self.limits, period) > 1.02 or not np.ptp(position, axis=0).any():
            return None
        shown = self.shower(position)
        try:
            pairs = np.array([margin(*q.run(shown, draws)) for q in self.questions])
            made = self.library.made(shown)
        except StageError:
            return None
        return Tried(motion, position, pairs, made @ made.transpose(0, 2, 1))

    def after(self, products: Array) -> Array:
        """Margins of the library (k, k + 1) in the session and an experiment beside it."""
        return self.library.margins(products, round(self.limits.duration / STEP))

    def score(self, tried: Tried) -> float:
        """Mean separation of the pairs and of the library, each between 0 and 1."""
        left = self.after(tried.products)[self.library.margins() < 1.0]
        return sum(float(np.mean(squashed(m))) for m in (tried.pairs, left) if len(m))

    def best(self, kind: str, generator: np.random.Generator) -> Tried | None:
        """The best motion of a kind: of a few, then refined near the best of them."""
        axes = len(self.limits.low)
        drawn = [draw(kind, generator, axes) for _ in range(STARTS)]
        bold = boldest(kind, axes)
        usual = [replace(bold, size=USUAL[0], speed=USUAL[1]), bold]
        able = [s for s in (self.tried(m, False) for m in (*usual, *drawn)) if s is not None]
        top = self.tried(max(able, key=self.score).motion, True) if able else None
        for _ in range(ROUNDS if top is not None else 0):
            assert top is not None
            moves = [top.motion.near(generator, REACH) for _ in range(TRIALS)]
            others = [self.tried(motion, True) for motion in moves]
            top = max([top, *(o for o in others if o is not None)], key=self.score)
        return top


@dataclass(frozen=True, eq=False)
class Tried:
    """A piece with the margins of the pairs and the products of what the library does in it."""

    motion: Motion
    position: Array
    pairs: Array
    products: Array

    def beside(self, others: list[Tried]) -> Tried:
        """All pieces: a pair is as far apart as in the one that shows it best, products add."""
        every = [self, *others]
        pairs = np.max([piece.pairs for piece in every], axis=0)
        products = np.sum([piece.products for piece in every], axis=0)
        return replace(self, pairs=pairs, products=products)


def _drawn(parameters: Parameters, generator: np.random.Generator) -> list[Effects]:
    """The parameters as they are, then drawn from their intervals within their bounds."""
    sets: list[Effects] = [plain_values(parameters)]
    for _ in range(DRAWS):
        drawn: dict[str, dict[str, float]] = {}
        for name, of in parameters.items():
            known = {p.name: p for p in effect_of(name).parameters}
            drawn[name] = {
                k: float(np.clip(generator.normal(v, s), known[k].minimum, known[k].maximum))
                if k in known and np.isfinite(s)
                else v
                for k, (v, s) in of.items()
            }
        sets.append(drawn)
    return sets
