"""Regression problems of a diagnosis: the tracker channels, and the force balance of each axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.evidence import judgement as judge
from gap_diagnosis.evidence.judgement import Structure
from gap_diagnosis.residuals.force_rows import ForceRows
from gap_diagnosis.residuals.kinematics import Kinematics
from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.selection.backward import select_backwards
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.imitations import imitations
from gap_diagnosis.selection.model import Evidence, Rules, Selection
from gap_diagnosis.selection.other_ways import select_best
from gap_diagnosis.selection.slow_rows import offered, speed_weights
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.quantities import split_effect
from stage_twin.effects import link_of

#: A gain in the force balance is told from noise that regressors share with the residual.
SERVO_RULES = Rules(of_noise=0.05, of_gap=6e-4)
KINEMATIC_RULES = Rules(of_gap=1e-5)
#: The alignment of a session took what is rigid out of the errors: scale and
#: squareness show only beside the rotation and the offset that it should have had.
REST_RULES = Rules(of_gap=1e-5, given=('tracker_misalignment',), prefer_plain=True)
#: Rests whose scatter is known: all effects at once are judged beside it.
KNOWN_REST_RULES = replace(REST_RULES, of_noise=0.2, level=0.995)

#: Rows that fit and rows that are held out: of samples in motion, and of rests of a stepper.
LEAST_ROWS, LEAST_RESTS = (200, 50), (8, 4)


@dataclass
class Part:
    """One regression problem: the tracker channels together, or the force balance of an axis."""

    name: str  # 'tracker' or 'servo.x'
    problem: Problem
    selector: Selector
    selection: Selection
    residual: Array  # of all rows, in the target's unit, never whitened
    row_axis: NDArray[np.int64]
    structure: judge.Structure
    rows: ForceRows | Kinematics | None = None  # what the problem was made of
    unconfirmed: tuple[str, ...] = ()  # what the residual shows and no run of the twin can
    swinging: tuple[str, ...] = ()  # accepted by the amount of the swing, not by its phase
    presliding: Mapping[str, float] = field(default_factory=dict)  # found of stated frictions [m]


def fit_part(
    name: str,
    problem: Problem,
    rules: Rules,
    seed: int,
    without: Sequence[str],
    least_rows: tuple[int, int] = LEAST_ROWS,
    known_noise: bool = False,
    weights: Array | None = None,
) -> Part:
    """Select the effects of one problem and judge what remains.

    Rows count by their `weights` (n,), or all alike.

    Raises
    ------
    StageError
        If there is too little motion to judge.
    """
    if any(
        np.count_nonzero(rows) < least
        for rows, least in zip((problem.fit, problem.held_out), least_rows, strict=True)
    ):
        fitted, held = np.count_nonzero(problem.fit), np.count_nonzero(problem.held_out)
        raise StageError(
            f'too little motion to judge {name}: {fitted} samples in motion to fit and {held} to '
            'judge by; record a longer session with `ros2 run contour_ctrl excite`'
        )
    for effect in without:
        base, axis = split_effect(effect)
        for term in [t for t in problem.terms if split_effect(t)[0] == base]:
            if axis is None or term == effect:
                del problem.terms[term]
    kept = tuple(effect for effect in problem.before if effect in problem.terms)
    shapes = dict(problem.terms)
    while True:
        part = _fit_whole(name, problem, rules, seed, known_noise, kept, weights)
        imitated = imitations(
            problem, part.selector, part.selection, part.residual, part.structure
        )
        if all(effect in kept for effect in imitated):
            for effect in kept:
                _count_whole(part, effect)
            part.selector.regression.forget()
            return part
        for effect in imitated:
            if effect not in kept:
                del shapes[effect]
        # The others start anew in their plain shapes: they may have grown beside an imitation.
        problem.terms.clear()
        problem.terms.update(shapes)


def _count_whole(part: Part, effect: str) -> None:
    """The evidence of an effect that was mostly taken out before is that of the whole of it."""
    rows = part.problem.judged
    gain = float(np.mean(part.problem.before[effect][rows] ** 2))
    part.selection.evidence[effect] = Evidence(effect, gain, (gain, gain), 1.0, True)


def _fit_whole(
    name: str,
    problem: Problem,
    rules: Rules,
    seed: int,
    known_noise: bool,
    kept: tuple[str, ...] = (),
    weights: Array | None = None,
) -> Part:
    """Selection on rows freed of their stands' errors, and of a slow remainder if there is one."""
    rules = replace(KNOWN_REST_RULES if known_noise else rules, kept=kept)
    calm, plain_shapes = problem.whitened(), dict(problem.terms)
    calm = calm if weights is None else calm.weighted(weights)
    selector = Selector(calm, rules, seed)
    selection = select_best(selector)
    beside_friction = speed_weights(problem, selection)
    if beside_friction is not None:
        problem.terms.clear()
        problem.terms.update({n: t for n, t in plain_shapes.items() if offered(n, selection)})
        calm = calm.weighted(beside_friction)
        selector = Selector(calm, rules, seed)
        selection = select_best(selector)
    if known_noise:
        selection = select_backwards(selector, selection)
    elif rules.given:  # rests too, whose scatter nobody stated
        unknown = replace(KNOWN_REST_RULES, kept=kept)
        selection = select_backwards(selector, selection, unknown)
    residual = residual_of(problem, selection)
    found = _structure(calm, selection, residual, name)
    if known_noise and not found.structured:
        found = _beyond_noise(problem, selection, found)
    rho = judge.slow_remainder(calm.whiten(residual), calm.judged) if name == 'tracker' else 0.0
    if found.structured and rho > 0.0 and weights is None:
        # A slow drift hides what is fast and imitates what is slow: judge beside it. Effects
        # that are nearly the whole gap are no imitation.
        plain = {n: e for n, e in selection.evidence.items() if e.share > 0.96}
        selector = Selector(problem.whitened(rho), rules, seed, calm.target)
        selection = select_best(selector)
        selection = selector.with_given(selection, plain)
        residual = residual_of(problem, selection)
        found = _structure(calm, selection, residual, name)
    return Part(name, problem, selector, selection, residual, np.zeros(0, np.int64), found)


def _structure(calm: Problem, selection: Selection, residual: Array, name: str) -> Structure:
    """What a residual (n,) as it was measured leaves beside its noise and its stands' errors.

    Where a curve was not told a row counts by how surely it was foreseen.
    """
    modelled = calm.whiten(_modelled(calm, selection, residual))
    answer = calm.whiten(_answer(calm, selection))
    foreseen = calm.whiten(residual) / np.sqrt(selection.fit.variance)
    return judge.structure(calm, foreseen, modelled, answer, name)


def _answer(problem: Problem, selection: Selection) -> Array:
    """What the effects of a selection make of the encoder's noise (n,)."""
    out = np.zeros(len(problem.target))
    for name, theta in selection.fit.thetas.items():
        answer = problem.terms[name].answer
        if answer is not None:
            out += answer(theta) @ selection.fit.coefficients[name]
    return out


def _beyond_noise(problem: Problem, selection: Selection, found: Structure) -> Structure:
    """Rests whose scatter is known: what they leave beyond twice of it is structure.

    Few rests follow one another in no order that an autocovariance could show.
    """
    remaining = selection.fit.mean_square(problem) - problem.floor**2
    gap = max(problem.mean_square(problem.judged) - problem.floor**2, 1e-300)
    share = min(max(remaining, 0.0) / gap, 1.0)
    return Structure(remaining, share, True) if remaining > 3.0 * problem.floor**2 else found


def _modelled(problem: Problem, selection: Selection, residual: Array) -> Array:
    """Residual with the effects of the sensor link alone taken out: what mechanics make."""
    out = residual.copy()
    for name in selection.fit.thetas:
        if link_of(name) != 'sensor':
            out += selection.fit.contribution(problem, name)
    return out


def residual_of(problem: Problem, selection: Selection) -> Array:
    """Residual of a selection in rows as they were measured.

    A held-out session has the nuisances that its own prefix gave.
    """
    fit = selection.fit
    residual = problem.target.copy()
    for name, theta in fit.thetas.items():
        share = fit.contribution(problem, name).copy()
        for number, refitted in fit.sessions.items():
            if name in refitted:
                rows = problem.record == number
                share[rows] = problem.terms[name].share(theta, refitted[name])[rows]
        residual -= share
    return residual
