"""The experiment: the pieces of motion that together tell the candidates apart best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gap_diagnosis.experiment.library import Library
from gap_diagnosis.experiment.motions import KINDS, PACES, Limits, Motion, amplitude, feed, joined
from gap_diagnosis.experiment.prediction import Predictor
from gap_diagnosis.experiment.questions import Pair, separated
from gap_diagnosis.experiment.scene import PIECE, Question, Scene, Tried
from gap_diagnosis.experiment.separation import decided
from stage_core.arrays import Array
from stage_core.errors import StageError

LONGER = 1.15  # ways between the pieces take time too


@dataclass(frozen=True)
class Experiment:
    """A motion and what is expected of it.

    Attributes
    ----------
    separates : the candidates
    expected : mean of what is expected of the pairs and of the library
    before : the same for the motions of the sessions
    pairs : names of each pair with the share of its drawn machines that is decided, before and
        expected
    library : effects at their usual size with the share of the others, nothing among them, from
        which they are told, before and expected
    motions : what the pieces are, in words
    position : reference (n, a) [m] at every tick of `period` [s]
    """

    separates: list[str]
    expected: float
    before: float
    pairs: list[tuple[tuple[str, str], float, float]]
    library: list[tuple[str, float, float]]
    motions: list[str]
    position: Array
    period: float
    axes: tuple[str, ...]

    @property
    def duration(self) -> float:
        """Length [s]."""
        return len(self.position) * self.period


def design(
    pairs: list[Pair],
    predictor: Predictor,
    limits: Limits,
    sessions: Sequence[Array],
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
    library: Library | None = None,
) -> Experiment | None:
    """The experiment that tells most of the pairs apart; None where nothing is open or can run.

    `sessions` (n, a) [m] are the motions that left the question open. A pair of which a side is no
    machine that could run it is no question. `library` are other effects that may be there.
    """
    generator = np.random.default_rng(seed)
    before = Scene(predictor, limits)
    asked = [Question(pair, generator) for pair in pairs]
    questions = [q for q in asked if not np.isnan(_before(before, [q], sessions)).any()]
    scene = Scene(predictor, limits, questions, library or Library())
    if not questions and not np.any(scene.library.margins() < 1.0):
        return None
    progress('the motion that decides: trying motions')
    best = [scene.best(kind, generator) for kind in KINDS]
    pool = [piece for piece in best if piece is not None]
    chosen = _together(scene, pool, int(limits.duration / (LONGER * PIECE)))
    if not chosen:
        return None
    position = joined([c.position for c in chosen], limits, predictor.twin.control_period)
    found = _told(scene, sessions, chosen, position)
    return found if questions or found.expected > found.before else None


def _told(
    scene: Scene, sessions: Sequence[Array], chosen: list[Tried], position: Array
) -> Experiment:
    """What is expected of a motion, beside the sessions."""
    names = [q.names for q in scene.questions]
    both = _before(scene, scene.questions, sessions), _decided(scene, scene.questions, position)
    pairs = list(zip(names, *(np.nan_to_num(b).tolist() for b in both), strict=True))
    margins = scene.library.margins(), scene.after(chosen[0].beside(chosen[1:]).products)
    asked = np.isfinite(margins[0])
    shares = [((m >= 1.0) & asked).sum(axis=1) / asked.sum(axis=1) for m in margins]
    library = [
        row
        for row in zip(scene.library.names, *(s.tolist() for s in shares), strict=True)
        if row[1] < 1.0
    ]
    rows = [*pairs, *library]
    axes = tuple(scene.predictor.twin.axes)
    return Experiment(
        separates=separated(names) or [name for name, then, now in library if now > then],
        expected=float(np.mean([now for _, _, now in rows])),
        before=float(np.mean([then for _, then, _ in rows])),
        pairs=pairs,
        library=library,
        motions=[_words(c.motion, scene.limits, axes) for c in chosen],
        position=position,
        period=scene.predictor.twin.control_period,
        axes=axes,
    )


def _before(scene: Scene, questions: list[Question], sessions: Sequence[Array]) -> Array:
    """Share that the session decides which decides most; nan where one of them cannot run."""
    each = [_decided(scene, questions, session) for session in sessions]
    return np.asarray(np.max(each, axis=0))


def _decided(scene: Scene, questions: list[Question], position: Array) -> Array:
    """Share of the drawn machines of each pair that a motion decides; nan where none can run."""
    shown = scene.shower(position)
    try:
        return np.array([decided(*q.run(shown, True)) for q in questions])
    except StageError:
        return np.full(len(questions), np.nan)


def _together(scene: Scene, pool: list[Tried], most: int) -> list[Tried]:
    """Pieces in the order in which they add to the separation of all together.

    All kinds have their turn, as long as there is time: what no candidate foresees shows in one
    of them.
    """
    chosen: list[Tried] = []
    left = list(pool)
    while left and len(chosen) < most:
        added = [scene.score(piece.beside(chosen)) for piece in left]
        chosen.append(left.pop(int(np.argmax(added))))
    return chosen


def _words(motion: Motion, limits: Limits, axes: tuple[str, ...]) -> str:
    """*strokes of x, ±4.1 mm at up to 52 mm/s*."""
    pace = PACES[motion.pace] if len(axes) == 2 else (1.0,)
    moving = [a for a, p in zip(axes, pace, strict=True) if p > 0.0 or motion.kind == 'raster']
    reach = 1e3 * float(amplitude(motion, limits)[axes.index(moving[0])])
    speed = 1e3 * feed(motion, limits)
    return f'{motion.kind} of {" and ".join(moving)}, ±{reach:.3g} mm at {speed:.3g} mm/s'
