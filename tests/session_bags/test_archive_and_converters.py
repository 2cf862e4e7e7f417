"""Archives of bags, and the converters of real measurements."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from session_bags import convert_emps, convert_ess_tank, convert_xy_circle
from session_bags.archive import find_bags, map_bags, result_path
from session_bags.check import ERROR, check_bag
from session_bags.measured import data_folder
from session_bags.reader import read_session
from session_bags.writer import write_session
from stage_core import topics
from stage_core.errors import StageError
from stage_core.twin_file import TwinFile

from .conftest import random_session


def count_references(bag: str) -> dict[str, int]:
    """What the archive's tests compute of a bag; at module level, so that processes find it."""
    session = read_session(bag, topics=[topics.REFERENCE])
    return {'references': len(session.require(topics.REFERENCE))}


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """Three good bags, two of them namesakes, and one that is cut."""
    folder = tmp_path / 'archive'
    for number, name in enumerate(('monday/run', 'tuesday/run', 'extra')):
        write_session(folder / name, random_session(10 + number))
    bad = write_session(folder / 'bad', random_session(5))
    (bad / 'bad_0.mcap').write_bytes((bad / 'bad_0.mcap').read_bytes()[:700])
    return folder


@pytest.mark.parametrize('jobs', [1, 2])
def test_one_bad_bag_is_reported_and_skipped(archive: Path, tmp_path: Path, jobs: int) -> None:
    bags = find_bags(archive)
    assert [bag.name for bag in bags] == ['bad', 'extra', 'run', 'run']
    # By its importable name: a spawned process knows nothing of pytest's modules.
    from session_bags.info import describe

    outcomes = map_bags(describe, bags, tmp_path / 'results', jobs=jobs, progress=False)
    assert [Path(outcome.bag) for outcome in outcomes] == bags
    described = [outcome for outcome in outcomes if outcome.result]
    assert all('/stage/reference' in outcome.result for outcome in described[-3:])


def test_resumes_where_it_was(
    archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bags = find_bags(archive)
    done: list[str] = []

    def counting(bag: str) -> dict[str, int]:
        done.append(bag)
        return count_references(bag)

    first = map_bags(counting, bags[:2], tmp_path / 'results', jobs=1, progress=False)
    assert first[0].error and 'bad' in first[0].error
    assert first[1].result == {'references': 12}
    done.clear()
    both = map_bags(counting, bags, tmp_path / 'results', jobs=1)
    assert done == [str(bags[0]), str(bags[2]), str(bags[3])], 'only what has no result yet'
    assert [o.result and o.result['references'] for o in both] == [None, 12, 10, 11]
    assert 'skipped' in capsys.readouterr().out
    assert result_path(tmp_path, bags[2]) != result_path(tmp_path, bags[3])


def test_an_unexpected_error_of_one_bag_is_its_own(archive: Path, tmp_path: Path) -> None:
    def odd(bag: str) -> int:
        raise ZeroDivisionError('odd')

    (outcome,) = map_bags(odd, find_bags(archive)[1:2], tmp_path / 'r', jobs=1, progress=False)
    assert outcome.error == 'ZeroDivisionError: odd'


def test_a_cluster_gives_the_same(archive: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip('distributed', reason='Dask is an optional extra')
    from session_bags.info import describe

    bags = find_bags(archive)[1:]
    here = map_bags(describe, bags, tmp_path / 'here', jobs=1, progress=False)
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as c:
        there = map_bags(
            describe, bags, tmp_path / 'there', scheduler=c.scheduler_address, progress=False
        )
    assert here == there


def test_what_cannot_be_done_is_said(tmp_path: Path, archive: Path) -> None:
    empty = tmp_path / 'empty'
    empty.mkdir()
    with pytest.raises(StageError, match='holds no bag'):
        find_bags(empty)
    with pytest.raises(StageError, match='scheduler'):
        map_bags(
            count_references, find_bags(archive), tmp_path / 'r', scheduler='tcp://127.0.0.1:9'
        )


def test_converters_keep_the_contract(data_root: Path, tmp_path: Path) -> None:
    for module in (convert_xy_circle, convert_emps, convert_ess_tank):
        assert module.main(['--out', str(tmp_path), '--data', str(data_root)]) == 0
    names = sorted(path.name for path in tmp_path.iterdir())
    assert len(names) == 11 and 'day2_b' in names and 'emps_pulses' in names
    for name in ('day1_a', 'emps', 'ess_tank_stroke'):
        assert not [f for f in check_bag(tmp_path / name) if f.level == ERROR]
    record = np.load(data_root / 'xy_circle' / 'day1_a.npz')
    session = read_session(tmp_path / 'day1_a')
    encoder = session.series[topics.JOINT_STATES].columns('position', ('x', 'y'))
    np.testing.assert_array_equal(encoder, record['encoder'])
    np.testing.assert_allclose(session.seconds(topics.REFERENCE), record['t'], atol=1e-9)
    assert session.twin is not None
    twin = TwinFile.from_dict(session.twin)
    for axis in ('x', 'y'):
        # Friction is well determined on the lap: between the two axes of the rig, 3 to 9 V·s/m.
        assert 2.0 < twin.axes[axis].viscous < 10.0 and twin.axes[axis].mass > 0.0  # type: ignore[union-attr]
    emps = read_session(tmp_path / 'emps')
    assert emps.axes == ('x',)
    # The published least-squares model explains the recorded force to 4.1 % (FACTS.md).
    joints, command = emps.series[topics.JOINT_STATES], emps.series[topics.COMMAND]
    velocity = joints.values['velocity.x']
    acceleration = np.gradient(velocity, emps.seconds(topics.JOINT_STATES))
    model = 95.109 * acceleration + 203.5 * velocity + 20.394 * np.sign(velocity) - 3.165
    moving = np.abs(velocity) > 0.005
    force = command.values['effort.x'][moving]
    assert np.linalg.norm(force - model[moving]) < 0.12 * np.linalg.norm(force)
    assert convert_emps.main(['--out', str(tmp_path), '--data', str(data_root)]) == 2


def test_absent_measurements_are_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv('STAGE_DATA', str(tmp_path / 'nowhere'))
    with pytest.raises(StageError, match='STAGE_DATA'):
        data_folder()
    assert convert_xy_circle.main(['--out', str(tmp_path)]) == 2
    assert convert_xy_circle.main(['--out', str(tmp_path), '--data', str(tmp_path)]) == 2
    assert capsys.readouterr().err.count('error: ') == 2
