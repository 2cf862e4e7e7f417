"""One shape of an effect that both a force balance and the tracker show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gap_diagnosis.residuals.uncertainty import uncertainty
from gap_diagnosis.selection.parts import Part, residual_of

#: What a force balance may lose by the tracker's shape, in the mean square of its noise. A mode of
#: the true frequency lost 0.04 of it: the noise of the encoder, which a heavier and slower load
#: seems to carry, is in the rows and in their columns.
LOST = 0.1


def with_shape_of(part: Part, tracker: Part) -> Part:
    """The force balance with the nonlinear parameters that the tracker is surer of.

    The coefficients beside them are fitted anew, so that no parameters of two different minima
    stand side by side.
    """
    for name in [n for n in part.selection.accepted if n in tracker.selection.accepted]:
        own, seen = part.selection.fit.thetas[name], tracker.selection.fit.thetas[name]
        if not own or len(own) != len(seen):
            continue
        doubts = [
            uncertainty(p.selector.regression, p.selection.fit)[name][0] for p in (part, tracker)
        ]
        if np.all(doubts[1] < doubts[0]):
            part = _shaped(part, name, seen)
    return part


def _shaped(part: Part, name: str, theta: tuple[float, ...]) -> Part:
    """The balance with an effect at other nonlinear parameters, if that loses next to nothing."""
    selector, fit = part.selector, part.selection.fit
    other = selector.regression.linear({**fit.thetas, name: theta})
    lost = other.mean_square(selector.problem) - fit.mean_square(selector.problem)
    if lost > LOST * selector.noise or not selector.admissible(other, name):
        return part
    selection = replace(part.selection, fit=other)
    return replace(part, selection=selection, residual=residual_of(part.problem, selection))
