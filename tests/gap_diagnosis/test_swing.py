"""A loop that swings by a play before the encoder, at a phase that no second run repeats."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.experiment.machine import session
from gap_diagnosis.closed_loop.axis_loop import AxisLoop
from gap_diagnosis.closed_loop.swing import swings_as_much
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.input.data import load_record
from gap_diagnosis.residuals.servo import Servo
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.selection.servo_part import hunting
from stage_core.session import Session
from stage_twin.effects.law_terms import SINE, VARIABLES
from tests.gap_diagnosis.conftest import nominal, reference

Maker = Callable[..., Session]
PLAY = {'width': 40e-6, 'mass_ratio': 0.3, 'contact_damping': 0.35}


def test_another_run_swings_as_much_and_half_a_play_does_not(planted: Maker) -> None:
    twin = nominal()
    record = load_record(planted({'drive_play.x': PLAY}), twin)
    for factor, wanted in ((1.02, True), (0.3, False), (4.0, False)):
        found = {'drive_play.x': {**PLAY, 'width': factor * PLAY['width']}}
        assert swings_as_much('drive_play.x', found, AxisLoop([record], twin, 'x')) is wanted


def test_a_damping_that_was_found_near_its_bound_is_tried_within_it(planted: Maker) -> None:
    twin = nominal()
    loop = AxisLoop([load_record(planted({'drive_play.x': PLAY}), twin)], twin, 'x')
    found = {'drive_play.x': {**PLAY, 'width': 5e-6, 'contact_damping': 1.9}}
    assert not swings_as_much('drive_play.x', found, loop)


def assert_product(found: Diagnosis, truth: Mapping[str, float]) -> None:
    """The product of width and mass is what shows."""
    values = found.effects['drive_play.x']
    product = values['width'] * values['mass_ratio']
    # A loop that swings goes another way by another rounding, so by another processor.
    assert abs(product / (truth['width'] * truth['mass_ratio']) - 1.0) < 0.25


def test_a_swing_is_named_by_the_force_balance(planted: Maker) -> None:
    found = diagnose([planted({'drive_play.x': PLAY})], [], nominal())
    assert found.verdict == ['drive_play.x']
    cause = next(c for c in found.causes if c.effect == 'drive_play.x')
    assert cause.unit == 'N'
    assert cause.gap_after < 0.3 * cause.gap_before
    assert found.after == found.before
    assert any('swing at a phase' in note for note in found.warnings)
    assert_product(found, PLAY)


def test_a_soft_play_is_named_although_a_resonance_stands_before_it(planted: Maker) -> None:
    soft = {'width': 9.3e-6, 'mass_ratio': 0.29, 'contact_frequency': 105.0}
    found = diagnose([planted({'drive_play.x': soft})], [], nominal())
    assert found.verdict == ['drive_play.x']
    assert_product(found, soft)


def test_a_play_with_very_soft_edges_is_named(planted: Maker) -> None:
    soft = {'width': 12e-6, 'mass_ratio': 0.2, 'contact_frequency': 70.0, 'contact_damping': 0.4}
    assert diagnose([planted({'drive_play.x': soft})], [], nominal()).verdict == ['drive_play.x']


def test_a_swing_faster_than_the_rows_of_the_balance_is_named() -> None:
    whole = nominal()
    coarse = replace(whole.axes['x'], encoder_resolution=5e-6)
    twin = replace(whole, axes={'x': coarse})
    fast = {'width': 90e-6, 'mass_ratio': 0.11, 'contact_frequency': 200.0}
    path = reference(12.0, twin.control_period, 1)
    machine = twin.with_effects({'drive_play.x': fast})
    record = session(machine, twin, path, np.full(len(path), 20.0), 0)
    rows = Servo([load_record(record, twin)], twin, 'x')
    assert math.isfinite(rows.cut)
    assert diagnose([record], [], twin).verdict == ['drive_play.x']


def test_what_shakes_the_machine_at_one_frequency_is_no_play() -> None:
    whole = nominal()
    light = replace(
        whole.axes['x'],
        **{'mass': 3.83, 'viscous': 7.5, 'encoder_resolution': 2e-7, 'lead': 0.02},
        **{'position_gain': 16.6, 'velocity_feedforward': 1.0, 'velocity_gain': 280.8},
        **{'integral_gain': 2718.0, 'velocity_filter': 416.0, 'force_limit': 60.0, 'delay': 1e-3},
    )
    twin = replace(whole, axes={'x': light}, tracker=None)
    sine = {'first0': float(VARIABLES['t'][0]), 'shape0': SINE, 'second0': 0.0, 'memory0': 0.0}
    shaken = {'size0': 4.0, 'scale0': 1.0 / 44.19, 'bend0': -0.44, 'reach0': 1e-6, **sine}
    path = reference(12.0, twin.control_period, 1)
    machine = twin.with_effects({'learned_force.x': shaken})
    record = session(machine, twin, path, np.full(len(path), 20.0), 0)
    assert diagnose([record], [], twin).verdict == ['unknown']


def test_a_friction_whose_loop_goes_another_way_is_judged_by_the_balance() -> None:
    """The twin of another integral gain hunts at other moments; that of the machine follows it."""
    whole = nominal()
    axis = replace(whole.servo('x'), integral_gain=8e3)
    twin = replace(whole, axes={'x': axis})
    path = 0.2 * reference(14.0, twin.control_period, 1)
    machine = twin.with_effects({'coulomb_friction.x': {'coulomb': 10.0, 'presliding': 0.0}})
    made = session(machine, twin, path, np.full(len(path), 20.0), 0)
    found = diagnose([made], [], twin)
    assert found.verdict == ['coulomb_friction.x'] and not found.parts[0].swinging
    other = replace(twin, axes={'x': replace(axis, integral_gain=24e3)})
    part = hunting(found.parts[0], AxisLoop(found.records, other, 'x'))
    assert part.swinging == ('coulomb_friction.x',)
    # A balance that it does not explain tells nothing that the loop contradicts.
    part.selector.noise, part.selector.gap = 1e-6 * part.selector.noise, 0.0
    assert not hunting(found.parts[0], AxisLoop(found.records, other, 'x')).swinging


@pytest.mark.parametrize('delay', [4.7e-3, 4.9e-3])
def test_a_delay_with_which_the_loop_swings_is_told_by_the_balance(delay: float) -> None:
    stated = {'coulomb': 3.0, 'presliding': 5e-6}
    twin = nominal().with_effects({'coulomb_friction.x': stated})
    # It swings at another phase than its twin, as its friction holds a little otherwise.
    friction = {'coulomb_friction.x': {**stated, 'presliding': 8e-6}}
    machine = twin.with_effects({**friction, 'actuation_delay.x': {'delay': delay}})
    path = reference(14.0, twin.control_period, 1)
    found = diagnose([session(machine, twin, path, np.full(len(path), 20.0), 0)], [], twin)
    assert found.verdict == ['actuation_delay.x']
    assert found.unrepeated == ('actuation_delay.x',)
    assert found.parameters['actuation_delay.x']['delay'][0] == pytest.approx(delay, rel=0.02)
