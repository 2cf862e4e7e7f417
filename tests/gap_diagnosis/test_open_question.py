"""A diagnosis after which something remains: its law, and what stands beside `unknown`."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.evidence.judgement import name_beside_unknown
from gap_diagnosis.report import document, page
from gap_diagnosis.report import experiment as file
from gap_diagnosis.residuals.nominal import Prediction
from gap_diagnosis.result import Diagnosis
from stage_core.pages import Page
from stage_core.session import Session
from stage_core.twin_file import TwinFile

from .conftest import nominal


@pytest.fixture(scope='module')
def open_question(planted: Callable[..., Session]) -> Diagnosis:
    """A diagnosis after which something remains: play that the library does not know."""
    session = planted({'backlash.x': {'width': 20e-6}}, axes=('x', 'y'), duration=12.0)
    found = diagnose([session], [], TwinFile.nominal_servo(), without=['backlash'])
    assert 'unknown' in found.verdict
    return found


def test_an_open_question_gets_a_law_beside_unknown(
    open_question: Diagnosis, tmp_path: Path
) -> None:
    """Play that the library does not know goes with the direction of the motion."""
    (law,) = (one for one in open_question.laws if one.channel == 'error.x')
    assert law.range.keys() == {'s'} and law.interval[0] > 0.8
    assert law.parameters['a1'][0] == pytest.approx(-10e-6, rel=0.05)
    assert law.parameters['reach1'][0] == pytest.approx(20e-6, rel=0.1)
    assert open_question.verdict == ['unknown']
    assert open_question.after == law.gap[0] > 5.0 * law.gap[1] / 2.0
    content = json.loads(document.write(open_question, tmp_path).read_text('utf-8'))
    assert content['law'][0]['expression'] == law.expression
    assert content['law'][0]['shrink_ci95'] == pytest.approx(law.interval)
    assert f'error of x = {law.expression}' in page.render(open_question)
    _twin_runs(open_question, law.after)


def _twin_runs(found: Diagnosis, after: float) -> None:
    """The corrected twin leaves of the held-out points what the law was said to leave."""
    record = found.records[0]
    own = Prediction(record, found.corrected_twin).table()[:, 0]
    part = next(p for p in found.parts if p.name == 'tracker')
    rows = part.row_axis == 0
    left = (part.problem.gap[rows] - own)[part.problem.held_out[rows]]
    assert np.sqrt(np.mean(left**2)) == pytest.approx(after, rel=0.02)


def test_what_no_run_can_confirm_stands_beside_unknown(open_question: Diagnosis) -> None:
    causes = [replace(c) for c in open_question.causes]
    name_beside_unknown(causes, [], ['drive_play.x', 'coulomb_friction.y'])
    beside = {c.effect: c.alternatives for c in causes if c.status == 'accepted'}
    assert beside['unknown'] == ['drive_play.x']
    shown = Page('test')
    file.section(shown, replace(open_question, causes=causes))
    assert 'drive_play.x would explain the force' in shown.render()


def test_a_force_law_is_judged_by_its_own_run(planted: Callable[..., Session]) -> None:
    spring = {'stiffness': 400.0, 'hardening': 0.0, 'centre': 0.0}
    record = planted({'cable_force.x': spring})
    barred = ('cable_force', 'position_force', 'force_ripple')
    (law,) = diagnose([record], [], nominal(), without=barred).laws
    assert law.unit == 'N' and law.runs
    assert law.gap[1] < 0.5 * law.gap[0]
