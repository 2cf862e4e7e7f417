"""What is told behind a stated friction with another presliding than the machine's."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.experiment.machine import session
from gap_diagnosis.closed_loop.axis_loop import AxisLoop
from gap_diagnosis.closed_loop.polish import LoopFit
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.parameters import Parameters
from gap_diagnosis.passes import prepare
from stage_core import topics
from stage_core.session import Session
from stage_core.twin_file import TwinFile

from .conftest import nominal, reference

FRICTION, LAG, CONSTANT = 'coulomb_friction.x', 'current_loop_lag.x', 'time_constant'
STATED = 3e-6  # presliding [m]


def fine(coulomb: float, presliding: float = STATED) -> TwinFile:
    """A twin with an encoder of 0.1 µm and a friction."""
    twin = nominal()
    axis = replace(twin.servo('x'), encoder_resolution=1e-7)
    friction = {FRICTION: {'coulomb': coulomb, 'presliding': presliding}}
    return replace(twin, axes={'x': axis}).with_effects(friction)


def lagging(coulomb: float, presliding: float, lag: float) -> Session:
    """A session without a tracker of a machine with a friction and a lag [s]."""
    twin = fine(coulomb, presliding)
    path = reference(12.0, twin.control_period, 1)
    machine, still = twin.with_effects({LAG: {CONSTANT: lag}}), 0.0 * path[:, 0]
    made = session(machine, twin, path, still, 0)
    series = {k: v for k, v in made.series.items() if k != topics.TRACKER_POINT}
    return replace(made, series=series)


@pytest.mark.parametrize(
    ('coulomb', 'presliding', 'lag'), [(4.0, 6e-6, 1.5e-3), (8.0, 5e-6, 1e-3)]
)
def test_a_lag_is_told_where_the_axis_slides(
    coulomb: float, presliding: float, lag: float
) -> None:
    found = diagnose([lagging(coulomb, presliding, lag)], [], fine(coulomb))
    assert found.verdict == [LAG]
    value, deviation = found.parameters[LAG][CONSTANT]
    assert abs(value - lag) < min(3.0 * deviation, 0.05 * lag)
    # With the machine's presliding nothing is left of the gap.
    assert any('The twin with presliding' in warning for warning in found.warnings)
    assert found.after < 1.2 * found.noise_floor
    corrected = found.corrected_twin.effects[FRICTION]['presliding']
    assert corrected == pytest.approx(presliding, rel=0.2)


@pytest.fixture(scope='module')
def loop() -> AxisLoop:
    twin = fine(4.0)
    records = prepare([lagging(4.0, 6e-6, 1.5e-3)], [], twin, []).records
    return AxisLoop(records, twin, 'x')


def test_a_refinement_where_the_axis_slides_holds_no_error_of_the_friction(loop: AxisLoop) -> None:
    balance: Parameters = {LAG: {CONSTANT: (0.6e-3, 0.26e-3)}}
    value, deviation = loop.refined(balance)[LAG][CONSTANT]
    assert value == pytest.approx(1.5e-3, rel=0.02) and deviation < 0.1e-3
    everywhere, _ = LoopFit(loop.records, loop.twin, 'x').polish(balance)[LAG][CONSTANT]
    assert abs(everywhere - 1.5e-3) > 0.3e-3


def test_a_friction_is_told_wherever_the_axis_goes(loop: AxisLoop) -> None:
    assert loop.beside([LAG]).sliding
    assert not loop.beside([LAG, FRICTION]).sliding
    free = replace(loop, twin=nominal())
    assert not free.beside([LAG]).sliding
