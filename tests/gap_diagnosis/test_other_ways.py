"""Selections that begin with an effect that another one was taken before."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.selection import other_ways
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.model import Rules, Selection
from stage_twin.effects.term import Term

FRICTION, DELAY = 'coulomb_friction.x', 'actuation_delay.x'
OTHER = 'position_force.x'


@pytest.mark.parametrize('better', [True, False])
def test_a_better_set_counts_without_the_effect_that_led_to_it(
    monkeypatch: pytest.MonkeyPatch, better: bool
) -> None:
    # A small rotation led to a play and a heat that leave nothing, and was pruned beside them.
    best = SimpleNamespace(accepted=['angular_error.y'])
    other = SimpleNamespace(accepted=['backlash.y', 'thermal_expansion.y'])
    terms: dict[str, Any] = {'angular_error.y': None}
    selector: Any = SimpleNamespace(
        problem=SimpleNamespace(terms=terms), gap=1.0, select=lambda first: other
    )
    monkeypatch.setattr(other_ways, '_better', lambda *sets: better)
    monkeypatch.setattr(other_ways, '_untold', lambda *sets: set())
    chosen: Any = other_ways._other_way(selector, best, ['tracker_misalignment'], terms, 1.0)  # type: ignore[arg-type]
    assert chosen is (other if better else best)


def test_a_smaller_set_that_lacks_most_of_what_it_leaves_is_no_better() -> None:
    """A delay is far less than one part in 1e4 of the gap, and most of what a friction leaves."""
    rows = np.arange(4000)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(rows))
    large, small = np.sign(np.sin(rows * 0.013)), np.sin(rows * 0.31)
    every, times = np.ones(len(rows), dtype=bool), np.asarray(rows * 1e-3, dtype=np.float64)
    terms = {
        FRICTION: Term(lambda theta: large[:, None], lambda theta, c: {'coulomb': float(c[0])}),
        DELAY: Term(lambda theta: small[:, None], lambda theta, c: {}),
    }
    target = 10.0 * large + 0.03 * small + noise
    problem = Problem(target, every, every, rows // 100, times, 0 * rows, terms, 1e-3)
    selector = Selector(problem, Rules(), 0)
    both, less = (selector.select(first) for first in ([FRICTION, DELAY], [FRICTION]))
    assert both.accepted == less.accepted == [FRICTION, DELAY]
    fit = selector.without_effect(both.fit, DELAY)
    alone = Selection([FRICTION], fit, {FRICTION: both.evidence[FRICTION]}, {})
    assert selector.least(DELAY) > 0.5 * 0.03**2
    assert not other_ways._better(selector, alone, both)
    assert other_ways._better(selector, both, alone)


def test_a_set_whose_effect_may_be_nothing_is_no_better(monkeypatch: pytest.MonkeyPatch) -> None:
    """An imitation of a friction is a little better, and leaves of the friction what is noise."""
    rows = np.arange(4000)
    more, noise = np.random.default_rng(2).standard_normal((2, len(rows)))
    more, noise = 0.1 * more, 0.01 * noise
    large = np.sign(np.sin(rows * 0.013))
    every, times = np.ones(len(rows), dtype=bool), np.asarray(rows * 1e-3, dtype=np.float64)
    imitation = (large + more)[:, None]
    terms = {
        FRICTION: Term(lambda theta: large[:, None], lambda theta, c: {'coulomb': float(c[0])}),
        OTHER: Term(lambda theta: imitation, lambda theta, c: {}),
    }
    target = large + more + noise
    problem = Problem(target, every, every, rows // 100, times, 0 * rows, terms, 1e-2)
    selector = Selector(problem, Rules(), 0)
    alone, beside, without = (
        Selection(names, selector.regression.linear(dict.fromkeys(names, ())), {}, {})
        for names in ([FRICTION], [OTHER, FRICTION], [OTHER])
    )
    assert other_ways._untold(selector, alone) == set()
    assert other_ways._untold(selector, beside) == {FRICTION}
    for other, chosen in ((beside, alone), (without, without)):
        assert other_ways._better(selector, other, alone)
        monkeypatch.setattr(selector, 'select', lambda first, other=other: other)
        assert other_ways._other_way(selector, alone, [], dict(terms), 1.0) is chosen
