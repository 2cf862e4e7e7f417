"""Curves over the travel end where the rows that fit end: beyond nothing would tell them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.experiment.machine import session
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.input.windows import fitted_ticks
from gap_diagnosis.passes import prepare
from gap_diagnosis.residuals.servo import Servo
from stage_core.session import Session
from stage_twin.effects import position_dependent_friction, position_force

from .conftest import nominal, reference

#: The last third of a block of 5 s is held out.
HELD = (3.4, 4.9)
LEVELS = {'c0': 4.0, 'c1': 9.0, 'c2': 5.0, 'c3': 8.0, 'c4': 4.0, 'c5': 9.0, 'c6': 6.0}


@pytest.fixture(scope='module')
def once_beyond() -> Session:
    """A session that goes to the end of its travel in a held-out window alone."""
    twin = nominal()
    path = reference(20.0, twin.control_period, 1)
    time = twin.control_period * np.arange(len(path))
    share = np.clip((time - HELD[0]) / (HELD[1] - HELD[0]), 0.0, 1.0)
    path[:, 0] += 0.4 * np.ptp(path[:, 0]) * np.sin(np.pi * share) ** 4
    ends = {'start': float(path[:, 0].min()), 'stop': float(path[:, 0].max())}
    friction = {'position_dependent_friction.x': {**ends, **LEVELS, 'presliding': 4e-6}}
    return session(twin.with_effects(friction), twin, path, np.full(len(path), 20.0), 0)


def test_each_knot_is_told(once_beyond: Session) -> None:
    (record,) = prepare([once_beyond], [], nominal(), []).records
    places, fit = record.encoder[:, 0], fitted_ticks(record)
    assert places.max() > places[fit].max() + 0.2 * np.ptp(places[fit])
    rows = Servo([record], nominal(), 'x')
    told, _ = rows.split()
    for effect in (position_dependent_friction, position_force):
        term = effect.term(rows)
        squares = np.sum(term.columns(term.grid[-1])[told] ** 2, axis=0)
        assert squares.min() > 1e-3 * squares.max(), effect.__name__


def test_a_friction_is_named_that_varies_where_it_is_told(once_beyond: Session) -> None:
    assert diagnose([once_beyond], [], nominal()).verdict == ['position_dependent_friction.x']
