"""The next experiment is a curve that the contour controller reads and plans."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from contour_ctrl.contour_parameters import PARAMETERS, make_curve, make_reference
from contour_ctrl.curves import check_regular
from gap_diagnosis.diagnose import Diagnosis
from gap_diagnosis.evidence import experiments
from gap_diagnosis.evidence.judgement import name_beside_unknown


def test_the_contour_controller_plans_the_next_experiment(
    open_question: Diagnosis, tmp_path: Path
) -> None:
    path = experiments.write_reference(open_question, tmp_path)
    assert path is not None
    values = {p.name: p.default for p in PARAMETERS}
    values |= {'contour': 'freeform', 'curve_file': str(path), 'reduce_feed': True, 'feed': 0.05}
    curve = make_curve(values.__getitem__)
    check_regular(curve)
    planned = make_reference(values.__getitem__, curve)
    encoder = open_question.records[0].encoder
    assert np.all(planned.position >= encoder.min(axis=0))
    assert np.all(planned.position <= encoder.max(axis=0))
    # Both axes reverse, each at several places of the other.
    for i in range(2):
        rate = planned.velocity[:, i]
        turns = np.flatnonzero(np.diff(np.sign(rate[np.abs(rate) > 1e-6])))
        assert len(turns) >= 5
    assert experiments.REFERENCE_FILE in ' '.join(experiments.steps(open_question))


def test_no_open_question_no_experiment(open_question: Diagnosis, tmp_path: Path) -> None:
    closed = replace(open_question, verdict=[], causes=[])
    assert experiments.write_reference(closed, tmp_path) is None
    assert list(tmp_path.iterdir()) == []


def test_what_no_run_can_confirm_stands_beside_unknown(open_question: Diagnosis) -> None:
    causes = [replace(c) for c in open_question.causes]
    name_beside_unknown(causes, [], ['drive_play.x', 'coulomb_friction.y'])
    beside = {c.effect: c.alternatives for c in causes if c.status == 'accepted'}
    assert beside['unknown'] == ['drive_play.x']
    told = ' '.join(experiments.steps(replace(open_question, causes=causes)))
    assert 'drive_play.x would explain the force' in told
