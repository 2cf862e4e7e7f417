"""An effect that a force balance shows too little of, and the closed loop shows well."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from gap_diagnosis.closed_loop.axis_loop import AxisLoop
from gap_diagnosis.diagnose import silent
from gap_diagnosis.evidence.judgement import strength
from gap_diagnosis.memory import Memory
from gap_diagnosis.passes import Prepared, prepare, servo_part
from gap_diagnosis.selection.lacking import with_lacking
from gap_diagnosis.selection.parts import Part
from stage_core.session import Session
from tests.gap_diagnosis.conftest import nominal

FRICTION, LAG = 'coulomb_friction.x', 'current_loop_lag.x'


def without_lag(planted: Callable[..., Session], lag: float) -> tuple[Part, Prepared]:
    """The balance of a friction and a lag [s], of which the selection overlooked the lag."""
    effects = {FRICTION: {'coulomb': 3.0}, LAG: {'time_constant': lag}}
    before = prepare([planted(effects)], [], nominal(), ())
    part = servo_part(before, 'x', before.direct, 0, [], Memory(), silent)
    fit = part.selector.without_effect(part.selection.fit, LAG)
    evidence = {FRICTION: part.selection.evidence[FRICTION]}
    selection = replace(part.selection, accepted=[FRICTION], fit=fit, evidence=evidence)
    return replace(part, selection=selection), before


def _loop(before: Prepared) -> AxisLoop:
    return AxisLoop(before.records, before.twin, 'x', before.direct)


def test_a_lag_that_the_balance_overlooked_is_taken_by_the_loop(
    planted: Callable[..., Session],
) -> None:
    part, before = without_lag(planted, 3e-3)
    found = with_lacking(part, _loop(before))
    assert found.selection.accepted == [FRICTION, LAG]
    assert found.selection.fit.thetas[LAG][0] == pytest.approx(3e-3, rel=0.1)
    assert strength(found, LAG) >= 1.0
    # A loop that follows the record lacks nothing.
    assert with_lacking(found, _loop(before)) is found


def test_a_friction_may_be_a_richer_one_for_the_loop(planted: Callable[..., Session]) -> None:
    """The balance took a level for a friction that breaks away with twice as much."""
    stribeck = 'stribeck_friction.x'
    values = {'coulomb': 4.0, 'breakaway': 3.0, 'stribeck_velocity': 4e-3, 'presliding': 1e-7}
    before = prepare([planted({stribeck: values})], [], nominal(), ())
    part = servo_part(before, 'x', before.direct, 0, [], Memory(), silent)
    assert part.selection.accepted == [stribeck]
    fit = part.selector.with_effect(part.selector.regression.linear({}), FRICTION)
    evidence = {FRICTION: replace(part.selection.evidence[stribeck], name=FRICTION)}
    plain = replace(part.selection, accepted=[FRICTION], fit=fit, evidence=evidence)
    overlooked = replace(part, selection=plain)
    found = with_lacking(overlooked, _loop(before))
    assert found.selection.accepted == [stribeck]


def test_the_only_effect_of_an_axis_may_be_one_that_the_balance_passes_over(
    planted: Callable[..., Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A ripple below the noise of the balance moves a soft loop by many floors of the encoder."""
    name = 'force_ripple.x'
    session = planted({name: {'amplitude': 0.15, 'period': 0.007}})
    before = prepare([session], [], nominal(), ())
    part = servo_part(before, 'x', before.direct, 0, [], Memory(), silent)
    nothing = part.selector.without_effect(part.selection.fit, name)
    overlooked = replace(part.selection, accepted=[], fit=nothing, evidence={})
    monkeypatch.setattr(
        'gap_diagnosis.selection.servo_part.fit_part',
        lambda *_: replace(part, selection=overlooked),
    )
    found = servo_part(before, 'x', before.direct, 0, [], Memory(), silent)
    assert found.selection.accepted == [name]
