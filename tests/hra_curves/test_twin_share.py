"""Table 5 on the twin of the NanoPla: its uncertainty, the shares, and what is refused."""

from __future__ import annotations

import functools
import sys

import numpy as np
import pytest

from hra_curves import cycloid, twin_share
from hra_curves.__main__ import main
from stage_core.twin_file import TwinFile

#: What Table 5 gives: its stops and its drives.
Rows = tuple[list[twin_share.Hold], list[twin_share.Drive]]


@pytest.fixture(scope='module')
def twin() -> TwinFile:
    return TwinFile.load(twin_share.default_twin())


@pytest.fixture(scope='module')
def result(twin: TwinFile) -> Rows:
    return twin_share.table5(twin, placings=8, hold=1.0, speed=2e-3)


def test_the_twin_has_the_uncertainty_of_the_paper(twin: TwinFile) -> None:
    uncertainty = twin_share.measured_uncertainty(twin, places=200)
    np.testing.assert_allclose(uncertainty, 0.50e-6, rtol=0.08)


def test_the_definition_dominates_with_splines_only(result: Rows) -> None:
    holds, drives = result
    shares = {(row.name, row.method): row.share for row in holds}
    assert len(holds) == 16
    for point in ('TP1', 'TP2', 'TP3', 'TP4'):
        assert shares[point, 'IB1'] < 0.1
        assert shares[point, 'IB1'] < shares[point, 'IB2'] < shares[point, 'linear']
        assert shares[point, 'CAM'] > 0.98
    driven = {row.method: row for row in drives}
    assert driven['IB1'].share < 0.05
    assert driven['CAM'].share > 0.9
    assert driven['linear'].largest_definition > driven['CAM'].largest_definition


def test_the_points_give_the_definition_errors_printed(result: Rows) -> None:
    errors = {(row.name, row.method): row.definition * 1e6 for row in result[0]}
    np.testing.assert_allclose(
        [errors[f'TP{k}', 'IB1'] for k in (1, 2, 3, 4)],
        [0.04, 0.03, 0.007, 0.007],
        rtol=0.1,
    )
    # TP1 and TP2 exchanged against the paper.
    np.testing.assert_allclose(
        [errors[f'TP{k}', 'CAM'] for k in (1, 2, 3, 4)], [3.8, 3.1, 4.5, 4.5], rtol=0.012
    )


def test_a_hold_reads_the_stage_and_not_the_motion(result: Rows, twin: TwinFile) -> None:
    assert twin.tracker is not None
    for row in result[0]:
        assert row.deviation == pytest.approx(twin.tracker.noise, rel=0.35)
        assert row.system < 0.5e-6


def test_the_plan_stops_where_it_should() -> None:
    curve = twin_share.defined_curve('CAM')
    session = twin_share.plan(curve, 0.001, 1.0, 2e-3)
    at = np.rint(session.starts / 0.001).astype(int)
    np.testing.assert_allclose(session.parameters[at], twin_share.STOPS, atol=1e-9)
    np.testing.assert_allclose(session.velocity[at + 100], 0.0, atol=1e-12)
    assert np.linalg.norm(session.velocity, axis=1).max() < 2.1e-3


def test_the_nearest_point_of_a_point_beside_the_curve() -> None:
    theta = np.linspace(0.5, 5.5, 50)
    normal = np.column_stack([np.cos(theta / 2.0), -np.sin(theta / 2.0)])
    points = cycloid.cycloid(theta)
    found = cycloid.nearest_points(points + 5e-6 * normal)
    np.testing.assert_allclose(found, points, atol=1e-9)
    distances = np.linalg.norm(found - points - 5e-6 * normal, axis=1)
    np.testing.assert_allclose(distances, 5e-6, atol=1e-10)


def test_without_the_twin_the_command_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, 'stage_twin.simulate', None)
    assert main(['table5']) == 2
    message = capsys.readouterr().err
    assert 'stage_twin' in message
    assert message.count('\n') == 1


def test_a_stepper_twin_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    stepper = twin_share.default_twin().with_name('twin_stepper_nominal.yaml')
    assert main(['table5', '--twin', str(stepper)]) == 2
    assert 'servo' in capsys.readouterr().err


def test_the_command_prints_paper_and_twin(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    brief = functools.partial(twin_share.table5, placings=1, hold=0.5, speed=4e-3)
    few = functools.partial(twin_share.measured_uncertainty, places=5)
    monkeypatch.setattr(twin_share, 'table5', brief)
    monkeypatch.setattr(twin_share, 'measured_uncertainty', few)
    assert main(['table5']) == 0
    printed = capsys.readouterr().out
    assert 'paper 0.50 µm' in printed
    assert 'TP4 linear' in printed
    assert '5.9 %' in printed  # 0.04 µm beside 0.01 +- 0.16 µm, the paper's TP1
