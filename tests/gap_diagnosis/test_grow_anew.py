"""Shapes of effects that became rich before the others were there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.model import Rules
from stage_twin.effects.term import Term

WAVE, LINE = 'cyclic_pitch_error.y', 'scale_error.y'
ROWS = np.arange(4000)
PLACE = np.abs((ROWS * 5e-4) % 2.0 - 1.0)  # strokes
SINE, SLOW = np.sin(40.0 * PLACE), np.sin(2.0 * PLACE)


@pytest.mark.parametrize(('slow', 'columns'), [(0.0, 1), (0.3, 2)])
def test_a_rich_shape_stays_where_it_is_needed_beside_all_others(
    slow: float, columns: int
) -> None:
    """A slow wave beside the sine takes a part of a line, as long as that is not there."""
    noise = 0.02 * np.random.default_rng(3).standard_normal(len(ROWS))
    every, times = np.ones(len(ROWS), dtype=bool), np.asarray(ROWS * 1e-3, dtype=np.float64)
    both = np.column_stack([SINE, SLOW])
    rich = Term(lambda theta: both, lambda theta, c: {})
    sine = replace(rich, columns=lambda theta: SINE[:, None], richer=lambda: rich)
    line = Term(lambda theta: PLACE[:, None], lambda theta, c: {})
    target = SINE + slow * SLOW + 0.3 * PLACE + noise
    problem = Problem(
        target, every, every, ROWS // 100, times, 0 * ROWS, {WAVE: sine, LINE: line}, 0.02
    )
    found = Selector(problem, Rules(), 0).select()
    assert found.accepted == [WAVE, LINE]
    assert len(found.fit.coefficients[WAVE]) == columns
