"""A corrected twin is the nominal one of the next diagnosis."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.experiment.machine import session
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.input.data import load_record
from gap_diagnosis.report import document as report
from gap_diagnosis.residuals.servo import Servo
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.parts import SERVO_RULES
from stage_core.session import Session
from stage_core.twin_file import TwinFile

from .conftest import nominal, reference

Maker = Callable[..., Session]

MACHINE = {
    'coulomb_friction.x': {'coulomb': 6.0, 'presliding': 1e-6},
    'backlash.x': {'width': 9e-6},
    'tracker_latency': {'latency': 2e-3},
}


def test_the_machine_that_was_diagnosed_has_no_gap_any_more(
    planted: Maker, tmp_path: Path
) -> None:
    found = diagnose([planted(MACHINE)], [], nominal())
    assert set(found.verdict) == set(MACHINE)
    report.write(found, tmp_path)
    corrected = TwinFile.load(tmp_path / 'corrected_twin.yaml')
    again = diagnose([planted(MACHINE, seed=4)], [], corrected)
    assert again.verdict == []
    assert again.before < 1.2 * again.noise_floor
    assert again.corrected_twin.effects == corrected.effects


def test_what_has_changed_since_is_named_and_estimated_anew(planted: Maker) -> None:
    changed = {
        'backlash.x': {'width': 20e-6},
        'tracker_latency': {'latency': 2e-3},
        'viscous_friction.x': {'viscous': 50.0},
    }
    found = diagnose([planted(changed)], [], nominal().with_effects(MACHINE))
    # The play has grown, there is viscous friction now, and no Coulomb friction any more.
    assert set(found.verdict) == {'backlash.x', 'viscous_friction.x', 'coulomb_friction.x'}
    assert found.after < 1.2 * found.noise_floor < 0.3 * found.before
    effects = found.corrected_twin.effects
    assert set(effects) == {*MACHINE, 'viscous_friction.x'}
    assert effects['backlash.x']['width'] == pytest.approx(20e-6, rel=0.05)
    assert effects['viscous_friction.x']['viscous'] == pytest.approx(50.0, rel=0.02)
    assert 0.0 <= effects['coulomb_friction.x']['coulomb'] < 0.1
    assert effects['tracker_latency'] == MACHINE['tracker_latency']


def test_what_holds_an_effect_of_the_twin_takes_its_place(planted: Maker) -> None:
    friction = {
        'coulomb_positive': 8.0,
        'coulomb_negative': 5.0,
        'viscous_positive': 20.0,
        'viscous_negative': 50.0,
    }
    machine = {**MACHINE, 'asymmetric_friction.x': friction}
    del machine['coulomb_friction.x']
    found = diagnose([planted(machine)], [], nominal().with_effects(MACHINE))
    assert found.verdict == ['asymmetric_friction.x']
    effects = found.corrected_twin.effects
    assert set(effects) == set(machine)
    for name, value in friction.items():
        assert effects['asymmetric_friction.x'][name] == pytest.approx(value, rel=0.05)


def test_a_stated_friction_is_as_inexact_as_one_that_is_found() -> None:
    stated = {'coulomb': 10.0, 'presliding': 1e-6}
    own = {**stated, 'breakaway': 11.0, 'stribeck_velocity': 2e-3, 'exponent': 1.0}
    whole = nominal()
    path = reference(14.0, whole.control_period, 1)
    machine = whole.with_effects({'stribeck_friction.x': own})
    made = session(machine, whole, path, np.full(len(path), 20.0), 0)
    found = diagnose([made], [], whole.with_effects({'coulomb_friction.x': stated}))
    assert found.verdict == ['stribeck_friction.x']


def test_what_the_twin_states_is_right_up_to_the_error_of_its_model(planted: Maker) -> None:
    twin = nominal().with_effects({'coulomb_friction.x': MACHINE['coulomb_friction.x']})
    rows = Servo([load_record(planted({}), twin)], twin, 'x')
    selector = Selector(rows.problem(), SERVO_RULES, 0)
    error = SERVO_RULES.of_gap * MACHINE['coulomb_friction.x']['coulomb'] ** 2
    selector.gap = 0.0  # all of it explained
    for name in ('coulomb_friction.x', 'asymmetric_friction.x', 'stribeck_friction.x'):
        assert selector.least(name, gain=1.0, rest=1.0) > 0.8 * error
    assert selector.least('viscous_friction.x', gain=1.0, rest=1.0) < 0.8 * error
