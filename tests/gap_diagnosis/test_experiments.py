"""The experiment: motions keep the limits, the best one decides, the stage can run it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from contour_ctrl.contour_parameters import PARAMETERS, make_timed
from gap_diagnosis.evidence.judgement import name_beside_unknown
from gap_diagnosis.experiment import motions
from gap_diagnosis.experiment.design import Experiment, design
from gap_diagnosis.experiment.motions import Limits
from gap_diagnosis.experiment.prediction import Noise, Predictor
from gap_diagnosis.experiment.questions import Pair
from gap_diagnosis.experiment.separation import Predicted, decided, margin
from gap_diagnosis.report import experiment as file
from gap_diagnosis.result import Diagnosis
from stage_core.errors import StageError
from stage_core.pages import Page
from stage_core.twin_file import TwinFile

PERIOD = 0.001
AXES = ('x', 'y')
LIMITS = Limits(
    np.array([-0.03, -0.02]), np.array([0.03, 0.02]), np.array([600.0, 600.0]), duration=21.0
)
NOISE = Noise(
    (math.inf,), np.full((1, 2), 0.01), np.full((1, 2), 0.2), 1e-3, np.full(2, 0.1), 1e-6
)
PREDICTOR = Predictor(TwinFile.nominal_servo(), NOISE, np.zeros(2))
OFFSET = {'force_offset.x': {'offset': (-10.0, 0.05)}}
FRICTION = {'coulomb_friction.x': {'coulomb': (10.0, 0.05), 'presliding': (2e-6, 1e-6)}}


def one_way() -> np.ndarray:
    """A session that never turns back."""
    s = np.clip(np.linspace(-0.1, 1.1, 4800), 0.0, 1.0)
    out = np.zeros((4800, 2))
    out[:, 0] = -0.02 + 0.04 * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return out


@pytest.fixture(scope='module')
def experiment() -> Experiment:
    """What separates friction from an offset after a session in one direction."""
    pair = Pair(('force_offset.x', 'coulomb_friction.x'), OFFSET, FRICTION, {})
    found = design([pair], PREDICTOR, LIMITS, one_way())
    assert found is not None
    return found


@pytest.mark.parametrize('kind', motions.KINDS)
def test_every_motion_keeps_the_limits_from_rest_to_rest(kind: str) -> None:
    generator = np.random.default_rng(1)
    kept = 0
    for _ in range(20):
        position = motions.sample(motions.draw(kind, generator, 2), LIMITS, 6.0, PERIOD)
        assert position.shape == (6000, 2)
        assert np.abs(position[-1] - position[0]).max() < 1e-9
        assert np.abs(np.diff(position, axis=0)[[0, -1]]).max() < 1e-8
        kept += motions.excess(position, LIMITS, PERIOD) <= 1.02
    # What is beyond a limit is passed over by the design.
    assert kept >= 15


def test_parameters_take_back_a_difference_that_they_can_make() -> None:
    common = np.zeros((1, 50))
    shape = np.sin(np.arange(50.0))[None]
    sure = Predicted(2.0 * shape, np.zeros((0, 1, 50)))
    unsure = Predicted(shape, np.stack([3.0 * shape, -shape]))
    other = Predicted(np.roll(shape, 3, axis=1), np.zeros((0, 1, 50)))
    assert margin(sure, unsure, common) < 0.05
    assert margin(sure, other, common) > 1.0
    assert decided(sure, other, common) == 1.0
    assert decided(sure, sure, common) == 0.0


def test_friction_and_offset_are_told_apart_by_a_motion_that_turns(
    experiment: Experiment,
) -> None:
    assert experiment.separates == ['force_offset.x', 'coulomb_friction.x']
    assert experiment.before == 0.0
    assert experiment.expected == 1.0
    assert experiment.duration <= 1.2 * LIMITS.duration
    assert motions.excess(experiment.position, LIMITS, PERIOD) <= 1.02
    rate = np.diff(experiment.position[:, 0])
    assert rate.max() > 1e-7 and rate.min() < -1e-7


def test_a_motion_that_needs_too_much_force_is_none() -> None:
    pair = Pair(('force_offset.x', 'coulomb_friction.x'), OFFSET, FRICTION, {})
    weak = replace(LIMITS, force=np.array([5.0, 5.0]))
    assert design([pair], PREDICTOR, weak, one_way()) is None


def test_the_contour_controller_takes_the_motion(experiment: Experiment, tmp_path: Path) -> None:
    path = file.write(experiment, tmp_path)
    values = {p.name: p.default for p in PARAMETERS}
    values |= {'contour': 'timed', 'curve_file': str(path)}
    reference = make_timed(values.__getitem__)
    count = min(len(reference), len(experiment.position))
    assert count > 0.99 * len(experiment.position)
    apart = np.abs(reference.position[:count] - experiment.position[:count]).max()
    assert apart < 1e-7
    slow = {**values, 'x.max_velocity': 1e-4, 'y.max_velocity': 1e-4}
    with pytest.raises(StageError, match='exceeds the speed limit'):
        make_timed(slow.__getitem__)
    path.write_text('t,x\n0,1\n')
    with pytest.raises(StageError, match='no timed motion'):
        make_timed(values.__getitem__)


def test_what_no_run_can_confirm_stands_beside_unknown(open_question: Diagnosis) -> None:
    causes = [replace(c) for c in open_question.causes]
    name_beside_unknown(causes, [], ['drive_play.x', 'coulomb_friction.y'])
    beside = {c.effect: c.alternatives for c in causes if c.status == 'accepted'}
    assert beside['unknown'] == ['drive_play.x']
    page = Page('test')
    file.section(page, replace(open_question, causes=causes))
    assert 'drive_play.x would explain the force' in page.render()
