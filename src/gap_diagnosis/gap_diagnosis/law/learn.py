"""From what the named effects leave to a law of it, judged where no fit has looked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.closed_loop.channels import Channel, position_rms
from gap_diagnosis.closed_loop.replay import replay
from gap_diagnosis.evidence.acceptance import Sides, shrink_interval
from gap_diagnosis.input.data import Record, scored_ticks
from gap_diagnosis.law.equation import Parameters, map_values, twin_values, unit_of, written
from gap_diagnosis.law.library import ERROR, FORCE, Candidate, candidates, term
from gap_diagnosis.law.maps import maps
from gap_diagnosis.law.search import Search
from gap_diagnosis.law.signals import Signals, error_signals, force_signals
from gap_diagnosis.residuals.force_rows import ForceRows
from gap_diagnosis.residuals.kinematics import Kinematics
from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.regression import Fit, Regression
from gap_diagnosis.selection.parts import LEAST_ROWS, Part
from stage_core.errors import StageError
from stage_core.twin_file import TwinFile
from stage_twin.effects.law_terms import CURVE, TERMS
from stage_twin.effects.term import Term, Theta

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Effects = Mapping[str, Mapping[str, float]]

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

    @property
    def shrink(self) -> float:
        """1 - after / before."""
        return 1.0 - self.after / self.before if self.before > 0.0 else 0.0

    @property
    def runs(self) -> bool:
        """Whether the twin, run with it, is nearer to the machine than without."""
        return self.gap[1] < self.gap[0]


def learn(
    records: Sequence[Record],
    twin: TwinFile,
    parts: Sequence[Part],
    effects: Effects,
    channels: Mapping[str, Channel],
    seed: int,
) -> list[Law]:
    """Laws of what remains in each part with structure, largest shrinkage first.

    Parameters
    ----------
    effects : the named ones, as the corrected twin holds them
    channels : the gap with these
    """
    found = []
    for part in parts:
        if not part.structure.structured:
            continue
        for problem, signals, axis in _problems(part, records):
            if np.count_nonzero(problem.fit) < LEAST_ROWS[0]:
                continue  # rests of a stepper
            law = law_of(problem, signals, axis, seed)
            if law is not None:
                law.gap = _gap(law, records, twin, effects, channels)
                found.append(law)
    return sorted(found, key=lambda law: -law.shrink)


def _problems(part: Part, records: Sequence[Record]) -> list[tuple[Problem, Signals, str]]:
    """The remainder of each axis of a part with the variables of its law."""
    rows = part.rows
    if isinstance(rows, ForceRows):
        # The force that acts on the mass is the opposite of what the drive has to make.
        problem = replace(part.problem, target=-part.residual, terms={})
        return [(problem, force_signals(rows), rows.axis)]
    assert isinstance(rows, Kinematics)
    out = []
    for i, axis in enumerate(rows.axes):
        if not any(r.moving[i] for r in records):
            continue
        problem = axis_problem(part.problem, part.residual, part.row_axis == i)
        out.append((problem, error_signals(rows, axis), axis))
    return out


def axis_problem(problem: Problem, target: Array, own: Mask) -> Problem:
    """The rows of one axis of the tracker's problem, without candidates."""
    names = ('fit', 'held_out', 'block', 'time', 'record')
    chosen = {name: getattr(problem, name)[own] for name in names}
    return replace(problem, target=target[own], terms={}, seams=None, before={}, **chosen)


def law_of(problem: Problem, signals: Signals, axis: str, seed: int) -> Law | None:
    """The law of one remainder; a map where no law holds, None where neither does.

    The rows that judge it take no part in the search: exponents, periods and the choice of terms
    come from the others, by cross-validation.
    """
    seen = replace(problem, held_out=np.zeros_like(problem.held_out), crossable=True)
    basis = candidates(FORCE if signals.unit == 'N' else ERROR, signals)
    fit, regression = _fitted(seen, {one: term(one, signals) for one in basis}, TERMS, seed)
    law = _judged(fit, regression, basis, problem, signals, axis, seed)
    if law is not None:
        return law
    curves = maps(signals)
    fit, regression = _fitted(seen, curves, 1, seed)
    return _judged(fit, regression, list(curves), problem, signals, axis, seed)


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
    signals: Signals,
    axis: str,
    seed: int,
) -> Law | None:
    """A fitted law with its figures on the held-out rows; None where it does not hold there."""
    rows = problem.held_out
    before, after = problem.target[rows] ** 2, fit.residual[rows] ** 2
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
    spread = regression.uncertainty(fit)
    texts: list[str] = []
    parameters = {}
    values: dict[str, float] = {}
    for k, (one, theta, c) in enumerate(chosen):
        text, own = written(k + 1, one, theta, c, spread[one.name], signals.unit)
        texts.append(text)
        parameters |= own
        values |= twin_values(k, one, theta, c)
    return ' + '.join(texts), parameters, values


def _gap(
    law: Law,
    records: Sequence[Record],
    twin: TwinFile,
    effects: Effects,
    channels: Mapping[str, Channel],
) -> tuple[float, float]:
    """RMS gap of all position channels with the named effects, and with the law beside them."""
    now, axis = position_rms(dict(channels), 'after'), law.channel[-1]
    if law.unit == 'm':
        name, gaps = f'tracker.{axis}', [np.full(1, law.after)]
        return now, position_rms({**channels, name: replace(channels[name], after=gaps)}, 'after')
    name = f'encoder.{axis}'
    scored = [r for r in records if r.held_out_session] or list(records)
    try:
        gaps = [
            replay(r, twin, {**effects, law.effect: law.values})[name][scored_ticks(r)]
            for r in scored
        ]
    except StageError:
        return now, float('inf')
    return now, position_rms({**channels, name: replace(channels[name], after=gaps)}, 'after')
