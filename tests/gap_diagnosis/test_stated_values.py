"""Where the search for a friction starts that the twin states with other values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.experiment.machine import session
from gap_diagnosis.evidence import causes
from gap_diagnosis.evidence.causes import judged_values
from gap_diagnosis.evidence.describe import describe, with_model_error
from gap_diagnosis.input.data import load_record
from gap_diagnosis.residuals.regression import Regression
from gap_diagnosis.residuals.servo import Servo
from gap_diagnosis.selection.parts import SERVO_RULES, fit_part
from stage_core.twin_file import TwinFile

from .conftest import nominal, reference

COULOMB, STRIBECK = 'coulomb_friction.x', 'stribeck_friction.x'
BREAKAWAY = {'coulomb': 9.0, 'presliding': 5.5e-7, 'breakaway': 3.0, 'stribeck_velocity': 6e-3}


def rows(stated: TwinFile, machine: TwinFile) -> Servo:
    """Force balance of a machine's run beside a twin that states something else."""
    path = reference(12.0, stated.control_period, 1)
    made = session(machine, stated, path, 0.0 * path[:, 0], 0)
    return Servo([load_record(made, stated)], stated, 'x')


def fine() -> TwinFile:
    axis = replace(nominal().servo('x'), encoder_resolution=1e-7)
    return replace(nominal(), axes={'x': axis})


@pytest.mark.parametrize('presliding', [4e-7, 8e-7])
def test_a_short_presliding_is_found_from_the_stated_one(presliding: float) -> None:
    """The stated value is a start: a dry one may tell no slope, the next one is longer."""
    stated = fine().with_effects({COULOMB: {'coulomb': 9.0, 'presliding': 5.5e-7}})
    machine = fine().with_effects({COULOMB: {'coulomb': 9.0, 'presliding': presliding}})
    regression = Regression(rows(stated, machine).problem())
    assert (5.5e-7,) in regression.problem.terms[COULOMB].grid
    start = regression.warm_start(regression.linear({}), COULOMB)
    found = regression.refine({COULOMB: start}, [COULOMB])
    assert found.thetas[COULOMB][0] == pytest.approx(presliding, rel=0.1)


@pytest.mark.parametrize('exponent', [0.8, 2.0])
def test_a_stated_stribeck_friction_is_in_the_plain_shape(exponent: float) -> None:
    twin = fine().with_effects({STRIBECK: {**BREAKAWAY, 'exponent': exponent}})
    problem = rows(twin, twin).problem()
    term = problem.terms[STRIBECK]
    stated = BREAKAWAY['presliding'], BREAKAWAY['stribeck_velocity']
    assert stated in term.grid
    assert term.base is not None
    left = term.base - term.columns(stated) @ np.array([9.0, 3.0])
    assert np.std(left) < 0.05 * np.std(term.base)
    assert term.parameters(stated, np.array([9.0, 3.0]))['exponent'] == exponent


def test_a_stated_friction_is_judged_with_its_shape_free(monkeypatch: pytest.MonkeyPatch) -> None:
    """A higher peak that falls at a lower speed is nearly the same friction."""
    known = {'coulomb': 3.3, 'breakaway': 0.35, 'stribeck_velocity': 1.9e-3, 'presliding': 7e-6}
    other = {'breakaway': 0.5, 'stribeck_velocity': 1.2e-3, 'presliding': 1.6e-5}
    stated = fine().with_effects({STRIBECK: known})
    machine = fine().with_effects({STRIBECK: {**known, **other}})
    part = fit_part('servo.x', rows(stated, machine).problem(), SERVO_RULES, 0, ())
    free = describe(part.selection, part.selector.regression)[STRIBECK]
    held = {name: (value, 0.1 * deviation) for name, (value, deviation) in free.items()}
    monkeypatch.setattr(causes, 'given_shape', lambda *_: held)
    assert judged_values(STRIBECK, free, part, stated) == with_model_error(STRIBECK, free)
    assert judged_values(STRIBECK, free, part, fine()) == with_model_error(STRIBECK, held)
