"""The law of one target: fitted, and judged where no fit has looked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.evidence.acceptance import Sides, shrink_interval
from gap_diagnosis.law.equation import Parameters, map_values, twin_values, unit_of, written
from gap_diagnosis.law.library import ERROR, FORCE, Candidate, candidates, term
from gap_diagnosis.law.maps import maps
from gap_diagnosis.law.search import Search
from gap_diagnosis.law.signals import Signals
from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.regression import Fit, Regression
from gap_diagnosis.residuals.uncertainty import uncertainty
from stage_core.arrays import Array
from stage_twin.effects.law_terms import CURVE, TERMS
from stage_twin.effects.term import Term, Theta

Mask = NDArray[np.bool_]

#: Least share of the held-out mean square above the noise that a law or a map has to take.
LEAST = 0.3
SHOWN = 3000  # rows of a picture


@dataclass
class Law:
    """What one remainder is a function of.

    Attributes
    ----------
    channel : ``force.x`` [N on the moving mass] or ``error.x`` [m along the axis]
    kind : `law`, or `map` for a curve without an equation
    expression : the right side of the equation in the names of `parameters`
    parameters : value, standard deviation and unit of each
    range : variable -> least value, largest value and unit, where it was seen
    before, after : RMS of the remainder on held-out rows [unit], without and with it
    interval : that of 95 % of `shrink`
    effect, values : as the corrected twin holds it
    gap : RMS gap of all position channels [m] with the named effects, and with the law
    instead : named effects in whose place it stands
    picture : variable of the picture, its values, remainder and law at some held-out rows
    """

    channel: str
    kind: str
    expression: str
    parameters: Parameters
    range: dict[str, tuple[float, float, str]]
    unit: str
    before: float
    after: float
    interval: tuple[float, float]
    effect: str
    values: dict[str, float]
    picture: tuple[str, Array, Array, Array]
    gap: tuple[float, float] = (0.0, 0.0)
    instead: tuple[str, ...] = ()

    @property
    def shrink(self) -> float:
        """1 - after / before."""
        return 1.0 - self.after / self.before if self.before > 0.0 else 0.0

    @property
    def runs(self) -> bool:
        """Whether the twin, run with it, is nearer to the machine than without."""
        return self.gap[1] < self.gap[0]


def law_of(
    problem: Problem, signals: Signals, axis: str, seed: int, remainder: Array | None = None
) -> Law | None:
    """The law of one target; a map where no law holds, None where neither does.

    It has to leave less than `remainder` (n,), which is the target where nothing else is given.

    The rows that judge it take no part in the search: exponents, periods and the choice of terms
    come from the others, by cross-validation.
    """
    seen = replace(problem, held_out=np.zeros_like(problem.held_out), crossable=True)
    basis = candidates(FORCE if signals.unit == 'N' else ERROR, signals)
    fit, regression = _fitted(seen, {one: term(one, signals) for one in basis}, TERMS, seed)
    before = problem.target if remainder is None else remainder
    law = _judged(fit, regression, basis, problem, before, signals, axis, seed)
    curves = maps(signals)
    fit, regression = _fitted(seen, curves, 1, seed)
    curve = _judged(fit, regression, list(curves), problem, before, signals, axis, seed)
    return curve if law is None or (curve is not None and _plainly_less(curve, law)) else law


def _plainly_less(one: Law, other: Law) -> bool:
    """Whether a law leaves less than another by as much as a law has to take."""
    return one.after**2 < (1.0 - LEAST) * other.after**2


def _fitted(
    seen: Problem, terms: Mapping[Candidate, Term], most: int, seed: int
) -> tuple[Fit, Regression]:
    named = {one.name: term for one, term in terms.items()}
    regression = Regression(replace(seen, terms=named))
    return Search(regression, seed).grow(most), regression


def _judged(
    fit: Fit,
    regression: Regression,
    basis: Sequence[Candidate],
    problem: Problem,
    remainder: Array,
    signals: Signals,
    axis: str,
    seed: int,
) -> Law | None:
    """A fitted law with its figures on the held-out rows; None where it does not hold there."""
    rows = problem.held_out
    before, after = remainder[rows] ** 2, fit.residual[rows] ** 2
    sides = [Sides(before, after, signals.unit, problem.floor)]
    excess = float(np.mean(before)) - problem.floor**2
    if not fit.thetas or float(np.mean(before - after)) < LEAST * excess:
        return None
    interval = shrink_interval(sides, seed)
    if interval[0] <= 0.0:
        return None
    chosen = [(one, fit.thetas[one.name], fit.coefficients[one.name])
              for name in fit.thetas for one in basis if one.name == name]  # fmt: skip
    # The largest term first: the report speaks of it.
    chosen.sort(key=lambda entry: -_size(regression, entry[0], entry[1], entry[2], rows))
    is_map = chosen[0][0].first.kind == CURVE
    expression, parameters, values = _said(fit, regression, chosen, signals, is_map)
    variables = dict.fromkeys(
        s.variable for one, *_ in chosen for s in one.shapes if s.variable != '1'
    )
    kind = 'error' if signals.unit == 'm' else 'force'
    first = next((v for v in variables if v != 's'), 't')
    at = np.flatnonzero(rows)[:: max(1, int(np.count_nonzero(rows)) // SHOWN)]
    picture = (
        first,
        signals.used(signals.ticks[first])[at],
        problem.target[at],
        (problem.target - fit.residual)[at],
    )
    return Law(
        channel=f'{kind}.{axis}',
        kind='map' if is_map else 'law',
        expression=expression,
        parameters=parameters,
        range={v: (*signals.range(v), unit_of(v)) for v in variables},
        unit=signals.unit,
        before=float(np.sqrt(np.mean(before))),
        after=float(np.sqrt(np.mean(after))),
        interval=interval,
        effect=f'learned_{kind}.{axis}',
        values=values,
        picture=picture,
    )


def _size(regression: Regression, one: Candidate, theta: Theta, c: Array, rows: Mask) -> float:
    return float(np.mean((regression.columns(one.name, theta)[rows] @ c) ** 2))


def _said(
    fit: Fit,
    regression: Regression,
    chosen: list[tuple[Candidate, Theta, Array]],
    signals: Signals,
    is_map: bool,
) -> tuple[str, Parameters, dict[str, float]]:
    """Expression, parameters, and the values of the twin's effect."""
    if is_map:
        one, theta, knots = chosen[0]
        size = 1.0 if signals.unit == 'N' else 1e-6
        ends = one.first.numbers(())
        parameters: Parameters = {
            f'k{k}': (float(value), 0.0, signals.unit) for k, value in enumerate(knots)
        }
        unit = unit_of(one.first.variable)
        parameters |= {'start': (ends[0], 0.0, unit), 'stop': (ends[1], 0.0, unit)}
        beside = '*s' if one.turning else ''
        text = f'curve({one.first.variable}){beside}'
        return text, parameters, map_values(one, theta, knots, size)
    spread = uncertainty(regression, fit)
    texts: list[str] = []
    parameters = {}
    values: dict[str, float] = {}
    for k, (one, theta, c) in enumerate(chosen):
        text, own = written(k + 1, one, theta, c, spread[one.name], signals.unit)
        texts.append(text)
        parameters |= own
        values |= twin_values(k, one, theta, c)
    return ' + '.join(texts), parameters, values
