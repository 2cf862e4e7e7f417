"""Accepted effects that only imitate what remains: a general curve would do better, or as well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gap_diagnosis.evidence.judgement import Structure
from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.regression import Fit
from gap_diagnosis.selection.forward import LACKING, Selector
from gap_diagnosis.selection.gains import block_rms_gains, bootstrap_interval
from gap_diagnosis.selection.model import Selection
from stage_core.arrays import Array
from stage_twin.effects import link_of
from stage_twin.effects.term import Theta

#: Least share of an effect's own contribution that a general curve over its condition may still
#: find in the remainder, before the effect is held for an imitation of something unknown. Models
#: of friction are approximations; a clock's latency and drift are exact.
UNEXHAUSTED = {'servo': 0.15, 'sensor': 0.04}
#: Share of what a resonance does in the tracker's rows that the encoder's noise makes, at most. It
#: was 0.87 and 0.90 of two that were none, 0.0004 at most of right ones of three simulators.
MADE = 0.5


def imitations(
    problem: Problem, selector: Selector, selection: Selection, residual: Array, left: Structure
) -> list[str]:
    """Accepted effects beside which a more general curve explains what they do, or as much.

    The right effect exhausts its condition: what a friction leaves is no function of the speed.
    Where structure remains and a general curve over the effect's own condition explains more than
    `UNEXHAUSTED` of what the effect does, something else of that kind was imitated. So was it
    where an offset does what the effect does: what is unknown has a mean, too. Nothing speaks for
    a curve `alone` where structure remains. A resonance that the tracker shows beside something
    unknown is most of what is left without it (`LACKING`): it follows any fast motion a little.
    Whatever remains, the encoder's noise makes no more than `MADE` of it.

    Parameters
    ----------
    residual : of all rows (n,) as they were measured: whitened ones weigh fast motion alone
    left : what of it is no noise
    """
    alone = [name for name in selection.accepted if problem.terms[name].alone]
    if left.structured and alone:  # beside it the others cannot be judged
        return alone
    found = []
    # What is given, as the alignment of a stepper's rests, is there whatever it explains.
    for name in [n for n in selection.accepted if n not in selector.rules.given]:
        if _of_noise(problem, selection, name) > MADE or (
            left.structured and _imitates(problem, selector, selection, residual, left, name)
        ):
            found.append(name)
    return found


def _of_noise(problem: Problem, selection: Selection, name: str) -> float:
    """Share of what an effect does that the encoder's noise makes.

    The motion by which a resonance is told holds that noise, as the rows do that it explains.
    """
    term, rows = problem.terms[name], problem.judged
    if term.answer is None or term.misread is None:
        return 0.0
    whole = selection.fit.contribution(problem, name)[rows]
    noise = term.answer(selection.fit.thetas[name])[rows] @ selection.fit.coefficients[name]
    return float(noise @ term.misread()[rows]) / float(whole @ whole)


def _imitates(
    problem: Problem,
    selector: Selector,
    selection: Selection,
    residual: Array,
    left: Structure,
    name: str,
) -> bool:
    """Whether a general curve, or an offset, does what an effect does beside what is unknown."""
    rows, fit = problem.judged, selection.fit
    seen = link_of(name) == 'servo' and not problem.signal
    if seen and selection.evidence[name].share < LACKING:
        return True
    size = float(np.mean(fit.contribution(problem, name)[rows] ** 2))
    if name in problem.signatures:
        more = _explained(problem.signatures[name]()[rows], residual[rows])
        return more > UNEXHAUSTED[link_of(name)] * size
    # An offset far beyond what remains is one.
    near = left.mean_square > UNEXHAUSTED['sensor'] * size
    return link_of(name) != 'servo' and near and _only_offset(selector, fit.thetas, name)


def _explained(basis: Array, residual: Array) -> float:
    """Mean square of what a basis (n, k) explains of a residual (n,)."""
    scale = np.linalg.norm(basis, axis=0)
    basis = basis[:, scale > 0.0] / scale[scale > 0.0]
    solution, *_ = np.linalg.lstsq(basis, residual, rcond=1e-8)
    return float(np.mean((basis @ solution) ** 2))


def _only_offset(selector: Selector, thetas: dict[str, Theta], name: str) -> bool:
    """Whether rows freed of their means show nothing of an effect."""
    measured = selector.as_measured()
    others = {n: theta for n, theta in thetas.items() if n != name}
    less, whole = (_freed(measured.problem, measured.linear(some)) for some in (others, thetas))
    gains = block_rms_gains(measured.problem, less, whole)
    low, _ = bootstrap_interval(gains, selector.seed, level=selector.rules.level)
    return low <= 0.0


def _freed(problem: Problem, fit: Fit) -> Fit:
    """A fit of which what is left is freed of the mean of each axis and session."""
    left, judged = fit.crossed.copy(), problem.judged
    starts = [0] if problem.seams is None else problem.seams.tolist()
    for start, stop in zip(starts, [*starts[1:], len(left)], strict=True):
        if judged[start:stop].any():
            left[start:stop] -= left[start:stop][judged[start:stop]].mean()
    return replace(fit, crossed=left)
