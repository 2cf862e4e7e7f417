"""A resonance that a tracker shows is more than what the encoder's noise makes of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.experiment.machine import session
from gap_diagnosis.evidence.judgement import Structure
from gap_diagnosis.input.data import load_record
from gap_diagnosis.residuals.kinematics import Kinematics
from gap_diagnosis.residuals.measured_noise import with_noise
from gap_diagnosis.selection.forward import Selector
from gap_diagnosis.selection.imitations import imitations
from gap_diagnosis.selection.model import Selection
from gap_diagnosis.selection.parts import KINEMATIC_RULES
from stage_core import topics
from stage_core.session import Session
from tests.gap_diagnosis.conftest import nominal, reference

SWINGS = 'structural_resonance.x'
SWING = {'frequency': 20.0, 'damping': 0.1, 'mass_ratio': 0.05, 'table_share': 3.0}


def read_with_noise(recorded: Session, noise: float) -> Session:
    """The session with white noise [m] on what its encoder reads."""
    states = recorded.series[topics.JOINT_STATES]
    name = 'position.x'
    draw = np.random.default_rng(7).standard_normal(len(states))
    values = {**states.values, name: states.values[name] + noise * draw}
    return replace(
        recorded, series={**recorded.series, topics.JOINT_STATES: replace(states, values=values)}
    )


@pytest.mark.parametrize(('hidden', 'imitates'), [({}, True), ({SWINGS: SWING}, False)])
def test_a_resonance_is_more_than_the_noise_of_the_encoder(
    hidden: dict[str, dict[str, float]], imitates: bool
) -> None:
    twin = nominal()
    path = 0.02 * reference(12.0, twin.control_period, 1)
    recorded = session(twin.with_effects(hidden), twin, path, np.full(len(path), 20.0), 0)
    records = [load_record(read_with_noise(recorded, 1e-6), twin)]
    problem = Kinematics(records, with_noise(twin, records), {}).problem()
    selector = Selector(problem.whitened(), KINEMATIC_RULES, 0)
    fit = selector.regression.linear({SWINGS: (20.0, 0.1)})
    evidence = selector.evidence(SWINGS, selector.regression.linear({}), fit)
    selection = Selection([SWINGS], fit, {SWINGS: evidence}, {})
    explained = Structure(0.0, 0.0, False)
    found = imitations(problem, selector, selection, problem.target, explained)
    assert found == ([SWINGS] if imitates else [])
