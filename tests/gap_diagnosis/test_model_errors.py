"""Drives that seem weaker, and masses larger, by the errors of other models."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gap_diagnosis.residuals.regression import Fit
from gap_diagnosis.selection.model import Evidence
from gap_diagnosis.selection.model_errors import model_errors
from stage_twin.effects.term import Term, constant

GAIN, SAG, PLAY = 'drive_gain.x', 'torque_sag.x', 'drive_play.x'
FRICTION, RIPPLE = 'coulomb_friction.x', 'force_ripple.x'


def errors(
    name: str = GAIN,
    left: float = 30.0,
    share: float = 0.13,
    structured: bool = False,
    gain: float = 50.0,
    stated: float = 0.0,
    base: Any = None,
    friction: float = 0.0,
    told: bool = False,
) -> list[str]:
    """What goes of a balance with noise of 1 that leaves `left`, with one effect of size 1.

    Its alternative has a `base` where the twin states it, with so many squares of its force. A
    `friction` of so many times the effect's size may stand beside it, and the loop have `told`
    the effect from that alternative.
    """
    plain = Term(constant(np.ones((4, 1))), lambda theta, c: {})
    terms = {name: plain, FRICTION: replace(plain, base=base), SAG: plain, RIPPLE: plain}
    evidence = {name: Evidence(name, gain, (0.1, 1.0), share, True, [FRICTION])}
    sizes = {name: 1.0} | ({FRICTION: friction} if friction else {})
    found = {n: np.array([size]) for n, size in sizes.items()}
    fit = Fit(dict.fromkeys(sizes, ()), found, np.zeros(4), np.full(4, np.sqrt(left)))
    part: Any = SimpleNamespace(
        problem=SimpleNamespace(terms=terms, stated=stated, judged=slice(None)),
        structure=SimpleNamespace(structured=structured),
        selector=SimpleNamespace(noise=1.0, rules=SimpleNamespace(of_gap=6e-4)),
    )
    selection: Any = SimpleNamespace(accepted=[name], evidence=evidence, fit=fit)
    return model_errors(part, selection, lambda own, others: told and others == [FRICTION])


def test_a_drive_gain_that_is_little_of_what_models_leave_goes_with_other_scales() -> None:
    assert errors() == [GAIN, FRICTION, SAG]


@pytest.mark.parametrize(
    'shown',
    [{'share': 0.63}, {'left': 1.5}, {'structured': True}, {'name': PLAY}],
    ids=['it is most of it', 'noise is left', 'an unknown is left', 'no scale'],
)
def test_what_no_error_of_a_model_can_be_stays(shown: dict[str, Any]) -> None:
    assert errors(**shown) == []


@pytest.mark.parametrize(
    ('gain', 'base', 'gone'),
    [(0.5, np.ones(4), [GAIN, FRICTION]), (0.7, np.ones(4), []), (0.5, None, [])],
    ids=['less than its error', 'more than its error', 'not stated'],
)
def test_what_other_values_of_a_stated_effect_explain_is_more_than_its_error(
    gain: float, base: Any, gone: list[str]
) -> None:
    # The error of the stated model is 6e-4 of its squares: 0.6.
    assert errors(left=1.0, share=1.0, gain=gain, stated=1000.0, base=base) == gone
    assert errors(left=1.0, share=1.0, gain=gain, stated=1000.0, base=base, told=True) == []


@pytest.mark.parametrize(
    ('name', 'friction', 'gone'),
    [(GAIN, 42.0, [GAIN, FRICTION, SAG]), (GAIN, 40.0, []), (PLAY, 42.0, [])],
    ids=['less than its error', 'more than its error', 'no scale'],
)
def test_a_scale_is_larger_than_the_error_of_a_friction(
    name: str, friction: float, gone: list[str]
) -> None:
    # The error of its model is 6e-4 of its squares: 1 / 40.8 of its force.
    assert errors(name, left=1.0, share=1.0, friction=friction) == gone
