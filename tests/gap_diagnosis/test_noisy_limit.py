"""A limit of the force in an effort that has noise of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.experiment.machine import session as run_of
from gap_diagnosis.input.data import Record, load_record
from gap_diagnosis.residuals import commands
from gap_diagnosis.residuals.commands import controller_findings
from stage_core import topics
from stage_core.session import Series
from stage_core.twin_file import TwinFile

from .conftest import nominal, reference


def limited(twin: TwinFile, limit: float) -> Record:
    """Record of a machine that has a limit [N], and 0.02 N of noise in its effort."""
    machine = replace(twin, axes={'x': replace(twin.servo('x'), force_limit=limit)})
    path = reference(14.0, twin.control_period, 1)
    made = run_of(machine, machine, path, np.full(len(path), 20.0), 0)
    old = made.series[topics.COMMAND]
    effort = old.values['effort.x'] + np.random.default_rng(4).normal(0.0, 0.02, len(old))
    series = Series(topics.COMMAND, old.stamps, {**old.values, 'effort.x': effort})
    return load_record(replace(made, series={**made.series, topics.COMMAND: series}), twin)


@pytest.mark.parametrize('step', [0.1e-6, 4e-6])
@pytest.mark.parametrize(('limit', 'named'), [(3.0, True), (6.0, True), (250.0, False)])
def test_a_limit_shows_although_the_effort_is_noisy(
    limit: float, named: bool, step: float
) -> None:
    """Beside coarse steps of the encoder [m] the force reaches its limit for a few ticks each."""
    axis = replace(nominal().servo('x'), encoder_resolution=step)
    twin = replace(nominal(), axes={'x': axis})
    told, _ = controller_findings([limited(twin, limit)], twin)
    assert ('force_saturation.x' in told) is named
    if named:
        assert told['force_saturation.x']['limit'][0] == pytest.approx(limit, abs=0.02)


def test_a_limit_stands_beside_gains_that_explain_slow_increments_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A force that mostly stands at its limit: other gains explain its mean, and no tick of it."""
    slow = {'velocity_gain_error': (-0.5, 0.01), 'integral_gain_error': (-0.9, 0.01)}
    # Noise of the encoder above its steps leaves the slow increments alone to be asked.
    monkeypatch.setattr(
        commands, 'mismatch', lambda records, i, axis: slow if axis.force_limit > 3.0 else {}
    )
    monkeypatch.setattr(commands, 'follows', lambda *asked: True)
    told, _ = controller_findings([limited(nominal(), 3.0)], nominal())
    assert set(told) == {'force_saturation.x'}
    assert told['force_saturation.x']['limit'][0] == pytest.approx(3.0, abs=0.02)
