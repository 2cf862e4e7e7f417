"""Parameters that the force balance cannot tell are told by the closed loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.experiment.machine import session
from gap_diagnosis.closed_loop.polish import LoopFit
from gap_diagnosis.input.data import Record, load_record
from stage_core.session import Session
from stage_twin.effects.friction import DRY
from tests.gap_diagnosis.conftest import nominal, reference

Maker = Callable[..., Session]


@pytest.mark.parametrize(('presliding', 'dry'), [(1e-7, True), (6e-6, False)])
def test_a_friction_that_holds_firmly_is_told_from_one_that_lets_the_loop_hunt(
    planted: Maker, presliding: float, dry: bool
) -> None:
    true = {'coulomb': 6.0, 'breakaway': 7.0, 'stribeck_velocity': 6e-3, 'presliding': presliding}
    twin = nominal()
    record = load_record(planted({'stribeck_friction.x': true}), twin)
    found = {'stribeck_friction.x': {k: (v, 0.02 * v) for k, v in true.items()}}
    found['stribeck_friction.x']['presliding'] = (5e-6, 5e-7)
    refined = LoopFit([record], twin, 'x').polish(found)['stribeck_friction.x']
    assert (refined['presliding'][0] <= DRY) is dry
    value, deviation = refined['presliding']
    assert abs(value - presliding) < 3.0 * deviation


def test_a_loop_far_from_the_record_refines_nothing(planted: Maker) -> None:
    true = {'viscous_friction.x': {'viscous': 200.0}}
    found = {'viscous_friction.x': {'viscous': (150.0, 10.0)}}
    alone = LoopFit([load_record(planted(true), nominal())], nominal(), 'x').polish(found)
    value, deviation = alone['viscous_friction.x']['viscous']
    assert abs(value - 200.0) < 2.0 * deviation
    play = {'drive_play.x': {'width': 60e-6, 'mass_ratio': 0.3}}
    swinging = load_record(planted({**true, **play}), nominal())
    assert LoopFit([swinging], nominal(), 'x').polish(found) == found


def test_a_presliding_that_the_balance_gave_a_hundredth_of_is_reached() -> None:
    whole = nominal()
    fine = replace(
        whole.axes['x'], encoder_resolution=1e-7, velocity_gain=600.0, integral_gain=6e3
    )
    twin = replace(whole, axes={'x': fine})
    true = {'coulomb': 4.0, 'breakaway': 2.0, 'stribeck_velocity': 4e-3, 'presliding': 1.6e-6}
    path = reference(12.0, twin.control_period, 1)
    machine = twin.with_effects({'stribeck_friction.x': true})
    record = load_record(session(machine, twin, path, np.full(len(path), 20.0), 0), twin)
    found = {'stribeck_friction.x': {k: (0.95 * v, 0.1 * v) for k, v in true.items()}}
    found['stribeck_friction.x']['presliding'] = (1.6e-8, 2.4e-8)
    refined = LoopFit([record], twin, 'x').polish(found)['stribeck_friction.x']
    for name, value in true.items():
        assert refined[name][0] == pytest.approx(value, rel=0.1), name
    # The loop is sure of what the balance was not: the balance's doubt is no part of its own.
    assert refined['breakaway'][1] < 0.5 * found['stribeck_friction.x']['breakaway'][1]


def test_a_resonance_that_coarse_counts_hide_is_found_within_its_deviation() -> None:
    """Noise in the acceleration draws the balance along what low frequencies tell alone."""
    whole = nominal()
    twin = replace(whole, axes={'x': replace(whole.axes['x'], encoder_resolution=1.5e-6)})
    true = {'frequency': 20.0, 'damping': 0.036, 'mass_ratio': 0.288}
    path = reference(20.0, twin.control_period, 1)
    machine = twin.with_effects({'structural_resonance.x': true})
    record = load_record(session(machine, twin, path, np.full(len(path), 20.0), 0), twin)
    wrong = {'frequency': (23.7, 0.1), 'damping': (0.05, 0.003), 'mass_ratio': (0.41, 0.003)}
    found = {'structural_resonance.x': wrong}
    refined = LoopFit([record], twin, 'x').polish(found)['structural_resonance.x']
    for name in ('frequency', 'mass_ratio'):
        distance = abs(refined[name][0] - true[name])
        assert distance < min(3.0 * refined[name][1], 0.1 * abs(wrong[name][0] - true[name])), name


@pytest.fixture(scope='module')
def recorded(planted: Maker) -> Record:
    return load_record(planted({}), nominal())


@given(
    st.floats(0.4, 3.0),
    st.floats(1e-9, 10.0),
    st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=1),
)
def test_no_step_leaves_the_range_of_a_parameter_even_by_a_rounding(
    recorded: Record, start: float, deviation: float, z: float
) -> None:
    found = {'stribeck_friction.x': {'exponent': (start, deviation)}}
    loop = LoopFit([recorded], nominal(), 'x')._loop([recorded], found)
    for place in (np.array([z]), *loop.bounds()):
        (value,) = loop.values(place)
        assert 0.4 <= value <= 3.0
