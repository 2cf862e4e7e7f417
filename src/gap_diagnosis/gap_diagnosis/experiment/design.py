"""The experiment: the pieces of motion that together tell the candidates apart best."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.experiment.motions import (
    KINDS,
    PACES,
    Limits,
    Motion,
    amplitude,
    draw,
    excess,
    feed,
    joined,
    sample,
)
from gap_diagnosis.experiment.prediction import Predictor
from gap_diagnosis.experiment.questions import Pair, separated
from gap_diagnosis.experiment.separation import Predicted, decided, margin
from gap_diagnosis.parameters import Parameters, plain_values
from stage_core.errors import StageError
from stage_twin.effects import effect_of

Array = NDArray[np.float64]
Effects = dict[str, dict[str, float]]
Runs = tuple[Predicted, Predicted, Array]

PIECE = 6.0  # s, of one motion
STARTS = 8  # random motions of each kind, judged without draws
ROUNDS, TRIALS, REACH = 2, 3, 0.15  # the best of a kind is refined: so many moves of that length
DRAWS = 3  # of the parameters of a candidate
SHARE_OF_FORCE = 0.8  # of the limit that a prediction may reach
LONGER = 1.15  # ways between the pieces take time too


@dataclass(frozen=True)
class Experiment:
    """A motion and what is expected of it.

    Attributes
    ----------
    separates : the candidates
    expected : mean share of the drawn pairs that the motion decides
    before : the same share for the motion of the session itself
    pairs : names of each pair with its share before and expected
    motions : what the pieces are, in words
    position : reference (n, a) [m] at every tick of `period` [s]
    """

    separates: list[str]
    expected: float
    before: float
    pairs: list[tuple[tuple[str, str], float, float]]
    motions: list[str]
    position: Array
    period: float
    axes: tuple[str, ...]

    @property
    def duration(self) -> float:
        """Length [s]."""
        return len(self.position) * self.period


class _Question:
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
class _Scene:
    """Runs questions on pieces of motion."""

    predictor: Predictor
    limits: Limits

    def run(self, questions: list[_Question], position: Array, draws: bool) -> list[Runs] | None:
        """Predictions of each; None where a force goes too far or something is no machine."""
        known: dict[str, Array] = {}

        def shown(effects: Effects) -> Array:
            key = repr(sorted(effects.items()))
            if key not in known:
                known[key], force = self.predictor.channels(effects, position)
                if np.any(force > SHARE_OF_FORCE * self.limits.force):
                    raise StageError('the force goes too far')
            return known[key]

        try:
            return [q.run(shown, draws) for q in questions]
        except StageError:
            return None

    def tried(self, questions: list[_Question], motion: Motion, draws: bool) -> _Tried | None:
        """A motion with the margin of every question; None where it is beyond a limit."""
        period = self.predictor.twin.control_period
        position = sample(motion, self.limits, PIECE, period)
        if excess(position, self.limits, period) > 1.02 or not np.ptp(position, axis=0).any():
            return None
        runs = self.run(questions, position, draws)
        margins = np.array([margin(*run) for run in runs or []])
        return None if runs is None else _Tried(motion, position, margins)

    def best(
        self, questions: list[_Question], kind: str, generator: np.random.Generator
    ) -> _Tried | None:
        """The best motion of a kind: of a few at random, then refined near the best of them."""
        axes = len(self.limits.low)
        starts = [self.tried(questions, draw(kind, generator, axes), False) for _ in range(STARTS)]
        able = [s for s in starts if s is not None]
        top = self.tried(questions, max(able, key=_Tried.score).motion, True) if able else None
        for _ in range(ROUNDS if top is not None else 0):
            assert top is not None
            moves = [top.motion.near(generator, REACH) for _ in range(TRIALS)]
            others = [self.tried(questions, motion, True) for motion in moves]
            top = max([top, *(o for o in others if o is not None)], key=_Tried.score)
        return top


@dataclass(frozen=True, eq=False)
class _Tried:
    """A piece with the margin of each pair on it."""

    motion: Motion
    position: Array
    margins: Array

    def score(self) -> float:
        """Mean separation over the pairs, between 0 and 1."""
        return float(np.mean(_squashed(self.margins)))


def design(
    pairs: list[Pair],
    predictor: Predictor,
    limits: Limits,
    session: Array,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> Experiment | None:
    """The experiment that tells the pairs apart; None where no motion within the limits does.

    `session` (n, a) [m] is the motion that left the question open. A pair of which a side is no
    machine that could run it is no question.
    """
    generator = np.random.default_rng(seed)
    scene = _Scene(predictor, limits)
    asked = [_Question(pair, generator) for pair in pairs]
    questions = [q for q in asked if scene.run([q], session, True) is not None]
    if not questions:
        return None
    progress('the motion that decides: trying motions')
    best = [scene.best(questions, kind, generator) for kind in KINDS]
    pool = [piece for piece in best if piece is not None]
    chosen = _together(pool, int(limits.duration / (LONGER * PIECE)))
    if not chosen:
        return None
    period, axes = predictor.twin.control_period, tuple(predictor.twin.axes)
    position = joined([c.position for c in chosen], limits, period)
    now = _decided(scene, questions, position)
    then = _decided(scene, questions, session)
    return Experiment(
        separates=separated([q.names for q in questions]),
        expected=float(np.mean(now)),
        before=float(np.mean(then)),
        pairs=[(q.names, b, a) for q, b, a in zip(questions, then, now, strict=True)],
        motions=[_words(c.motion, limits, axes) for c in chosen],
        position=position,
        period=period,
        axes=axes,
    )


def _decided(scene: _Scene, questions: list[_Question], position: Array) -> list[float]:
    runs = scene.run(questions, position, True)
    return [0.0] * len(questions) if runs is None else [decided(*run) for run in runs]


def _together(pool: list[_Tried], most: int) -> list[_Tried]:
    """Pieces in the order in which they add to the separation of all pairs together.

    A pair is as far apart as in the piece that shows it best. All kinds have their turn, as long
    as there is time: what no candidate foresees shows in one of them.
    """
    chosen: list[_Tried] = []
    left = list(pool)
    best = np.zeros(len(pool[0].margins)) if pool else np.zeros(0)
    while left and len(chosen) < most:
        piece = max(left, key=lambda p: float(np.mean(_squashed(np.maximum(best, p.margins)))))
        best = np.maximum(best, piece.margins)
        chosen.append(piece)
        left.remove(piece)
    return chosen


def _squashed(margins: Array) -> Array:
    """Margins as shares: half where they just decide, near 1 far beyond that."""
    return np.asarray(margins / (1.0 + margins))


def _drawn(parameters: Parameters, generator: np.random.Generator) -> list[Effects]:
    """The parameters as they are, then drawn from their intervals within their bounds."""
    sets = [plain_values(parameters)]
    for _ in range(DRAWS):
        drawn: Effects = {}
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


def _words(motion: Motion, limits: Limits, axes: tuple[str, ...]) -> str:
    """*strokes of x, ±4.1 mm at up to 52 mm/s*."""
    pace = PACES[motion.pace] if len(axes) == 2 else (1.0,)
    moving = [a for a, p in zip(axes, pace, strict=True) if p > 0.0 or motion.kind == 'raster']
    reach = 1e3 * float(amplitude(motion, limits)[axes.index(moving[0])])
    speed = 1e3 * feed(motion, limits)
    return f'{motion.kind} of {" and ".join(moving)}, ±{reach:.3g} mm at {speed:.3g} mm/s'
