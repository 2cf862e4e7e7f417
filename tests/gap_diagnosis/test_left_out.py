"""What a pass leaves out of the next one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.evidence.left_out import FAR_MORE, LIKELY, explained_better, left_out
from gap_diagnosis.passes import prepare
from gap_diagnosis.selection.parts import SERVO_RULES
from stage_core.quantities import UNKNOWN
from stage_core.session import Session

from .conftest import nominal

TERMS = {'current_loop_lag.x': None, 'actuation_delay.x': None}


def balance(
    left: float,
    accepted: list[str],
    floor: float = 0.1,
    name: str = 'servo.x',
    gap: float = 1.0,
) -> Any:
    """A force balance of which effects leave a mean square of the gap's, beside the noise."""
    return SimpleNamespace(
        name=name,
        structure=SimpleNamespace(mean_square=left),
        problem=SimpleNamespace(floor=floor, terms=TERMS),
        selection=SimpleNamespace(accepted=accepted),
        selector=SimpleNamespace(rules=SERVO_RULES, gap=gap),
    )


def test_no_effect_follows_one_that_explained_far_more() -> None:
    least: dict[str, float] = {}
    assert explained_better([balance(0.01, ['actuation_delay.x'])], least) == []
    nearly = balance(0.99 * FAR_MORE * 0.01, ['current_loop_lag.x'])
    assert explained_better([nearly], least) == []
    worse = balance(1.01 * FAR_MORE * 0.01, ['current_loop_lag.x'])
    assert explained_better([worse], least) == list(TERMS)
    assert explained_better([balance(3.0, [])], least) == []
    assert least == pytest.approx({'servo.x': 0.01})


def test_what_is_left_below_the_noise_is_noise() -> None:
    least: dict[str, float] = {}
    assert explained_better([balance(1e-9, ['actuation_delay.x'])], least) == []
    assert explained_better([balance(0.02, ['current_loop_lag.x'])], least) == []


def test_a_difference_that_matters_of_no_effect_is_none() -> None:
    least: dict[str, float] = {}
    assert explained_better([balance(0.01, ['viscous_friction.x'], gap=1e3)], least) == []
    assert explained_better([balance(0.5, ['viscous_friction.x'], gap=1e3)], least) == []
    assert explained_better([balance(0.7, ['viscous_friction.x'], gap=1e3)], least) == list(TERMS)


def test_the_tracker_is_no_balance_and_other_axes_count_alone() -> None:
    least: dict[str, float] = {}
    explained_better([balance(0.01, ['a']), balance(0.01, ['a'], name='tracker')], least)
    other = balance(1.0, ['actuation_delay.y'], name='servo.y')
    assert explained_better([other, balance(1.0, ['b'], name='tracker')], least) == []


@pytest.mark.parametrize(
    ('probability', 'alternatives', 'beside', 'own', 'goes'),
    [
        (0.99 * LIKELY, [], [UNKNOWN], False, True),
        (LIKELY, [], [UNKNOWN], True, False),
        (LIKELY, ['drive_gain.x'], [UNKNOWN], True, True),
        (0.99 * LIKELY, ['drive_gain.x'], [UNKNOWN], False, False),
        (0.99 * LIKELY, ['drive_gain.x'], [], True, False),
    ],
)
def test_an_effect_that_is_rather_not_there_goes_beside_an_unknown(
    planted: Callable[..., Session],
    probability: float,
    alternatives: list[str],
    beside: list[str],
    own: bool,
    goes: bool,
) -> None:
    """One that others replace goes where the `unknown` is of its `own` balance."""
    name = 'viscous_friction.x'
    session = planted({name: {'viscous': 200.0}})
    found = diagnose([session], [], nominal())
    assert found.verdict == [name]
    (cause,) = (c for c in found.causes if c.effect == name)
    cause.probability, cause.alternatives = probability, alternatives
    found.verdict += beside
    found.parts = [
        replace(p, structure=replace(p.structure, structured=own and p.name == 'servo.x'))
        for p in found.parts
    ]
    out, _ = left_out(found, prepare([session], [], nominal(), []), {}, 0)
    assert out == ([name] if goes else [])
