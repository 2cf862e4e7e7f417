"""Friction found again in sessions whose friction is known."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from contour_ctrl.excitation import excitation
from contour_ctrl.feedrate import AxisLimits
from contour_ctrl.friction_estimate import FrictionEstimate
from contour_ctrl.identify_friction import identify, identify_session, main
from session_bags.writer import write_session
from stage_core import topics
from stage_core.errors import StageError
from stage_core.session import Series, Session, by_topic
from stage_core.twin_file import TwinFile
from stage_twin.simulate import SimulationResult, simulate

FRICTION = {
    'stribeck_friction.x': {
        'coulomb': 20.0,
        'breakaway': 8.0,
        'stribeck_velocity': 8e-3,
        'presliding': 4e-6,
    },
    'stribeck_friction.y': {
        'coulomb': 8.0,
        'breakaway': 2.0,
        'stribeck_velocity': 5e-3,
        'presliding': 3e-6,
    },
    'force_offset.y': {'offset': 3.0},
}
LIMITS = AxisLimits((0.2, 0.2), (2.0, 2.0), (500.0, 500.0))
REFERENCE = excitation((0.03, 0.03), speeds=(0.015, 0.06), multisine_time=4.0, limits=LIMITS)


@pytest.fixture(scope='module')
def record() -> SimulationResult:
    twin = TwinFile.nominal_servo().with_effects(FRICTION)
    return simulate(twin, REFERENCE.position, REFERENCE.velocity, noise=False)


def session_of(record: SimulationResult) -> Session:
    stamps = (np.rint(record.times * 1e9)).astype(np.int64) + 5_000_000_000
    series = by_topic(
        Series.per_axis(topics.JOINT_STATES, stamps, position=record.encoder),
        Series.per_axis(topics.COMMAND, stamps, effort=record.force),
    )
    return Session('memory', series)


def estimates(session: Session) -> list[FrictionEstimate]:
    """Those of x and y; both axes have friction."""
    found = identify_session(session)
    return [e for e in (found['x'], found['y']) if isinstance(e, FrictionEstimate)]


def test_friction_of_the_twin_is_found_again(record: SimulationResult) -> None:
    x, y = estimates(session_of(record))
    assert x.model.coulomb == pytest.approx(20.0, rel=0.005)
    assert x.model.static == pytest.approx(28.0, rel=0.02)
    assert x.model.stribeck_velocity == pytest.approx(8e-3, rel=0.05)
    assert x.mass == pytest.approx(18.0, rel=0.01)
    assert x.model.viscous == pytest.approx(40.0, abs=1.0)
    assert y.model.coulomb == pytest.approx(8.0, rel=0.005)
    # The offset acts on the mass: the drive holds it with the opposite sign.
    assert y.offset == pytest.approx(-3.0, abs=0.02)
    assert abs(x.offset) < 0.02
    for estimate in (x, y):
        assert estimate.residual < 0.5 * estimate.residual_without
    # 28 N over 4 µm and 10 N over 3 µm: one count of the encoder is 7 N and 3.3 N.
    for estimate, stiffness in ((x, 28.0 / 4e-6), (y, 10.0 / 3e-6)):
        assert estimate.model.stiffness == pytest.approx(stiffness, rel=0.1)
        assert abs(estimate.model.stiffness - stiffness) < 3.0 * estimate.std['stiffness']
        assert estimate.std['stiffness'] < 0.1 * stiffness


def test_stiffness_without_slow_reversals_is_a_guess_and_says_so() -> None:
    ref = excitation((0.03, 0.03), speeds=(0.06,), multisine_time=4.0, limits=LIMITS, micro_time=0)
    twin = TwinFile.nominal_servo().with_effects(FRICTION)
    x, _ = estimates(session_of(simulate(twin, ref.position, ref.velocity, noise=False)))
    assert x.std['stiffness'] == np.inf and '(std unknown)' in x.sentence()
    assert x.model.coulomb == pytest.approx(20.0, rel=0.02)


def test_an_axis_without_friction_gets_no_parameters(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """x has no friction; that of y moves the force by less than its ripple, then is clear."""
    for force, told in ((0.001, False), (8.0, True)):
        friction = {'stribeck_friction.y': FRICTION['stribeck_friction.y'] | {'coulomb': force}}
        if not told:
            friction['stribeck_friction.y'] |= {'breakaway': 0.0}
        twin = TwinFile.nominal_servo().with_effects(friction)
        session = session_of(simulate(twin, REFERENCE.position, REFERENCE.velocity, noise=False))
        bag = write_session(tmp_path / f'{force}', session)
        assert main(['--bag', str(bag)]) == 0
        printed = capsys.readouterr().out
        assert printed.startswith('x: no friction can be told from this bag')
        assert 'x.coulomb' not in printed
        assert ('y: no friction can be told' in printed) is not told
        assert ('    y.stiffness' in printed) is told
    assert re.search(r'F_c [78]\.\d+ N \(std .* N\), .* m/s, sigma_0 .* N/m', printed)


def test_what_cannot_be_identified_is_told(record: SimulationResult) -> None:
    rising = np.linspace(0.0, 1.0, 5000)
    with pytest.raises(StageError, match='never reverses'):
        identify(rising, np.ones(5000), 1e-3)
    with pytest.raises(StageError, match='too short'):
        identify(rising[:100], np.ones(100), 1e-3)
    broken = record.force[:, 0].copy()
    broken[7] = np.nan
    with pytest.raises(StageError, match='not finite'):
        identify(record.encoder[:, 0], broken, 1e-3)
    empty = Session('memory', {})
    with pytest.raises(StageError, match='holds no message of /stage/joint_states'):
        identify_session(empty)


def test_command_needs_a_bag(capsys: pytest.CaptureFixture[str], tmp_path: object) -> None:
    with pytest.raises(SystemExit) as caught:
        raise SystemExit(main(['--bag', f'{tmp_path}/absent']))
    assert caught.value.code == 2
    assert capsys.readouterr().err.count('\n') == 1
