"""An effect that makes the loop swing, judged in rows that hold what is fast.

A play before the encoder makes the loop swing at 20 to 100 Hz. The rows of a force balance show
little of that where a cut keeps the encoder's noise out of the accelerations, so it is judged in
rows without the cut. Beside it stand what the balance has shown, and forces of place and speed:
what else follows the acceleration or the force would take up the noise that these rows hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.regression import Fit, Regression
from gap_diagnosis.residuals.servo import Servo
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.gains import block_rms_gains, bootstrap_interval
from gap_diagnosis.selection.model import Selection
from gap_diagnosis.selection.parts import SERVO_RULES, Part, residual_of
from gap_diagnosis.selection.rivals import find_rivals
from stage_core.quantities import split_effect
from stage_twin.effects import effect_of
from stage_twin.effects.term import Term

#: Forces of place and speed, which may stand beside an effect that swings.
BESIDE = (
    *('coulomb_friction', 'viscous_friction', 'asymmetric_friction', 'stribeck_friction'),
    *('force_offset', 'cable_force', 'force_ripple'),
)
#: What makes an axis swing or lag in other ways, and has to explain less.
RIVALS = ('structural_resonance', 'base_resonance', 'actuation_delay', 'current_loop_lag')
#: Mean square of the remainder over that of the noise, from which on a swing is looked for. Axes
#: without one had 1.1 at most, those that swing 2.9 to 87.
FAST = 2.0
#: Share of the remainder that one sine explains, from which on the machine is shaken: what shakes
#: it keeps its phase over the session. Of the swings of 16 right plays a sine explained 0.72 at
#: most, of a shaken machine's 0.997.
STEADY = 0.9
#: Least share of the remainder that an effect which swings explains: 13 right plays explain 0.54
#: to 1.00, a wrong one 0.34 of the rest of a friction. One of 0.84, of a wave that the encoder
#: misreads, is kept out by `drive_play.SLOWEST`, and one of 0.58, of a load on a spring, by
#: `drive_play.LIVELIEST`.
EXPLAINS = 0.5
PAD = 4  # steps of the spectrum in one turn over the session


def swinging_part(part: Part, rows: Servo, seed: int, barred: Sequence[str]) -> Part | None:
    """The balance by an effect that swings; None where none explains nearly all that is fast."""
    problem = _with_shapes(rows.unlimited().problem().whitened(), part.selection.fit)
    everything = dict(problem.terms)
    names = [n for n in everything if effect_of(n).swings and _free(n, barred)]
    if not names or not (set(names) & set(part.selection.accepted) or _fast(problem, part)):
        return None
    if _steady(problem, part, names):
        return None
    shown = [n for n in part.selection.accepted if n not in names and not _rival(n)]
    beside = [n for n in everything if split_effect(n)[0] in BESIDE and _free(n, barred)]
    for name in names:
        problem.terms.clear()
        problem.terms.update({n: everything[n] for n in (name, *shown, *beside)})
        # No error of a model that goes with the force of the axis swings as fast.
        problem.terms[name] = replace(everything[name], follows=0.0)
        selector = Selector(problem, SERVO_RULES, seed)
        selection = selector.select((*shown, name))
        found = selection.evidence.get(name)
        problem.terms.update({**everything, **problem.terms})
        if found is None or found.share < EXPLAINS:
            continue
        rivals = [n for n in everything if _rival(n) and _free(n, barred)]
        if all(_better(selector, selection.fit, name, rival) for rival in rivals):
            find_rivals(selector, selection)
            return _part(part, selector, selection, name)
    return None


def _fast(problem: Problem, part: Part) -> bool:
    """Whether the rows without the cut hold more than noise and what a balance found with it."""
    left = Regression(problem).linear(part.selection.fit.thetas).mean_square(problem)
    return left > FAST * problem.floor**2


def _steady(problem: Problem, part: Part, swinging: Sequence[str]) -> bool:
    """Whether one sine of a constant phase explains what an effect that swings would explain."""
    known = {n: theta for n, theta in part.selection.fit.thetas.items() if n not in swinging}
    left = Regression(problem).linear(known).residual
    explained = 0.0
    for number in np.unique(problem.record[problem.fit]).tolist():
        rows = problem.fit & (problem.record == number)
        time = problem.time[rows]
        tick = np.rint((time - time[0]) / np.median(np.diff(time))).astype(np.int64)
        spectrum = np.fft.rfft(np.bincount(tick, left[rows]), PAD * (int(tick[-1]) + 1))
        explained += 2.0 * float(np.max(np.abs(spectrum)) ** 2) / len(tick)
    return explained > STEADY * float(np.sum(left[problem.fit] ** 2))


def _free(name: str, barred: Sequence[str]) -> bool:
    return name not in barred and split_effect(name)[0] not in barred


def _rival(name: str) -> bool:
    return split_effect(name)[0] in RIVALS


def _better(selector: Selector, fit: Fit, name: str, rival: str) -> bool:
    """Whether a set explains more for certain than with another effect in the place of one."""
    less = selector.without_effect(fit, name)
    other = selector.with_effect(less, rival)
    gains = block_rms_gains(selector.problem, other, fit)
    return bootstrap_interval(gains, selector.seed, level=selector.rules.level)[0] > 0.0


def _part(part: Part, selector: Selector, selection: Selection, name: str) -> Part:
    """A part of the rows without the cut; the moments of impacts leave no structure."""
    selection = replace(selection, rejected={**part.selection.rejected, **selection.rejected})
    return replace(
        part,
        problem=selector.problem,
        selector=selector,
        selection=selection,
        residual=residual_of(selector.problem, selection),
        structure=replace(part.structure, structured=False),
        swinging=(name,),
    )


def _with_shapes(problem: Problem, fit: Fit) -> Problem:
    """The problem with its terms as rich as they are in a fit."""
    for name, theta in fit.thetas.items():
        term = problem.terms[name]
        while not _fits(term, theta, len(fit.coefficients[name])) and term.next is not None:
            term = term.next
        problem.terms[name] = term
    return problem


def _fits(term: Term, theta: tuple[float, ...], count: int) -> bool:
    return len(term.lower) == len(theta) and term.columns(theta).shape[1] == count
