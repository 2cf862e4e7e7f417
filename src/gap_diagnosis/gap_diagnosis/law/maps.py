"""A smooth map in place of a law: a curve through knots over one variable."""

from __future__ import annotations

import numpy as np

from gap_diagnosis.law.library import REACHES, Candidate, Shape
from gap_diagnosis.law.signals import Signals
from stage_core.arrays import Array
from stage_twin.effects import law_terms as lt
from stage_twin.effects.knots import smooth
from stage_twin.effects.term import Term, Theta

#: Points of the curve of one knot, between which it is straight.
POINTS = 481


def maps(signals: Signals) -> dict[Candidate, Term]:
    """A curve over each variable, alone and times the direction of the motion."""
    found = {}
    for name in sorted({'p', 'v', 'q', 'T', 't', 'u'} & signals.ticks.keys()):
        low, high = signals.range(name)
        shape = Shape(name, lt.CURVE, numbers=lambda theta, ends=(low, high): ends)  # type: ignore[misc]
        for times in (None, Shape('s', lt.LINEAR)):
            if times is None or signals.direction is not None:
                one = Candidate(shape, times)
                found[one] = _term(one, signals, low, high)
    return found


def _term(one: Candidate, signals: Signals, low: float, high: float) -> Term:
    at = np.linspace(low, high, POINTS)
    curves = [np.array([smooth(x, low, high, unit) for x in at]) for unit in np.eye(lt.KNOTS)]
    ticks = signals.ticks[one.first.variable]

    def columns(theta: Theta) -> Array:
        made = [[np.interp(x, at, curve) for x in ticks] for curve in curves]
        if one.turning and signals.direction is not None:
            way = signals.direction(theta[0])
            made = [[x * s for x, s in zip(signal, way, strict=True)] for signal in made]
        return signals.columns(*made)

    grid = REACHES if one.turning else ((),)
    return Term(columns, lambda theta, c: {}, grid=grid)
