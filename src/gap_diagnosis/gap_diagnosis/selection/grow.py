"""Richer shapes of accepted effects: harmonics of a period, orders of a curve, lags."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gap_diagnosis.residuals.regression import Fit
from gap_diagnosis.selection.gains import block_gains, bootstrap_interval
from gap_diagnosis.selection.possible import refined

if TYPE_CHECKING:
    from gap_diagnosis.selection.forward import Selector

#: Least gain of a richer shape as a share of the noise's mean square: below it, it would not be
#: seen in the gap.
OF_NOISE_GROWN = 2e-3


def grow(selector: Selector, fit: Fit, names: list[str]) -> Fit:
    """Effects in as rich a shape as held-out data bear: harmonics, orders of a curve.

    An order that alone gains nothing may do so with later ones: all are tried. Where one ends at
    parameters that no machine has, the next is searched anew.
    """
    terms = selector.problem.terms
    for name in names:
        plain, theta, lost = terms[name], fit.thetas[name], False
        while terms[name].deepens(fit.thetas[name]) and (richer := terms[name].next) is not None:
            terms[name] = richer
            if lost or richer.own or len(richer.lower) > len(theta):
                others = {n: t for n, t in fit.thetas.items() if n != name}
                theta = selector.regression.warm_start(selector.regression.linear(others), name)
            trial = refined(selector, {**fit.thetas, name: theta}, [name], rounds=8)
            theta, lost = trial.thetas[name], not selector.admissible(trial, name)
            if not lost and _worth_it(selector, fit, trial):
                fit, plain = trial, terms[name]
        terms[name] = plain
    return fit


def grow_anew(selector: Selector, fit: Fit, names: list[str]) -> Fit:
    """Effects of a whole set, grown anew where one had become rich before all others were there.

    Its shape may have stood for them: waves of four periods of a pitch error for a squareness.
    From its plainest shape it grows beside them, if the richer one is no better for certain.
    """
    terms = selector.problem.terms
    for name in names:
        rich, terms[name] = terms[name], selector.plainest[name]
        if rich is not terms[name]:
            others = {n: t for n, t in fit.thetas.items() if n != name}
            theta = selector.regression.warm_start(selector.regression.linear(others), name)
            anew = refined(selector, {**fit.thetas, name: theta}, [name], rounds=8)
            anew = grow(selector, anew, [name])
            if selector.admissible(anew, name) and not _worth_it(selector, anew, fit):
                fit = anew
                continue
            terms[name] = rich
        fit = grow(selector, fit, [name])
    return fit


def _worth_it(selector: Selector, plain: Fit, rich: Fit) -> bool:
    """Whether a richer shape shows on rows that no fit has seen."""
    gains = block_gains(selector.problem, plain, rich)
    low, _ = bootstrap_interval(gains, selector.seed, level=selector.rules.level)
    return low > 0.0 and float(gains.mean()) > OF_NOISE_GROWN * selector.noise
