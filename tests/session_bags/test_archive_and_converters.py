"""Archives of bags, and the converters of real measurements."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from session_bags import (
    convert_emps,
    convert_ess_tank,
    convert_odrive_cogging,
    convert_xy_circle,
)
from session_bags.archive import (
    ENDED,
    Where,
    find_bags,
    is_bag,
    map_bags,
    map_items,
    result_path,
)
from session_bags.check import ERROR, check_bag
from session_bags.info import describe
from session_bags.measured import data_folder
from session_bags.reader import read_session
from session_bags.writer import write_session
from stage_core import topics
from stage_core.errors import StageError
from stage_core.twin_file import TwinFile

from .conftest import random_session


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """Three good bags, two of them namesakes, and one whose file is none."""
    folder = tmp_path / 'archive'
    for number, name in enumerate(('monday/run', 'tuesday/run', 'extra')):
        write_session(folder / name, random_session(10 + number))
    bad = write_session(folder / 'bad', random_session(5))
    (bad / 'bad_0.mcap').write_bytes(b'no mcap at all')
    return folder


QUIET = Where(jobs=1, progress=False)
TWO = Where(jobs=2, progress=False)
#: Ends the process that evaluates it.
DIES = "__import__('os').kill(__import__('os').getpid(), 9)"


def test_bags_of_a_folder(archive: Path, tmp_path: Path) -> None:
    bags = find_bags(archive)
    assert [bag.name for bag in bags] == ['bad', 'extra', 'run', 'run']
    assert find_bags(bags[1]) == [bags[1]]
    assert is_bag(bags[1]) and not is_bag(archive)
    assert result_path(tmp_path, str(bags[2])) != result_path(tmp_path, str(bags[3]))
    (tmp_path / 'empty').mkdir()
    with pytest.raises(StageError, match='holds no bag'):
        find_bags(tmp_path / 'empty')
    with pytest.raises(StageError, match='there is no bag'):
        find_bags(tmp_path / 'absent')


def test_all_places_give_the_same(archive: Path, tmp_path: Path, dask_cluster: str) -> None:
    """One bag is bad: it is reported and skipped."""
    bags = find_bags(archive)
    places = (QUIET, TWO, Where(scheduler=dask_cluster, progress=False))
    here, processes, cluster = (
        map_bags(describe, bags, tmp_path / str(number), where=where)
        for number, where in enumerate(places)
    )
    assert here == processes == cluster
    assert [Path(outcome.item) for outcome in here] == bags
    assert 'bad' in here[0].error and not here[0].result
    assert all('/stage/reference' in outcome.result for outcome in here[1:])


@pytest.mark.parametrize('place', ['one process', 'processes', 'cluster'])
def test_a_bad_item_is_its_own(place: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    """`eval` stands for any function: it is found by name in every process."""
    items = ['1 + 1', '1 / 0', '[1.5, None]', 'no_such_name', '3 * 3']
    where = QUIET
    if place == 'processes':
        items.append(DIES)
        where = TWO
    if place == 'cluster':
        items.append(DIES)
        where = Where(scheduler=request.getfixturevalue('dask_cluster'), progress=False)
    # The first to start: items that wait behind it are none the worse for it.
    items.reverse()
    outcomes = map_items(eval, items, tmp_path, where=where)
    assert [outcome.item for outcome in outcomes] == items
    outcomes.reverse()
    assert [outcome.result for outcome in outcomes][:5] == [2, None, [1.5, None], None, 9]
    assert outcomes[1].error == 'ZeroDivisionError: division by zero'
    assert 'NameError' in outcomes[3].error
    assert [outcome.error for outcome in outcomes[5:]] == [ENDED] * len(items[5:])


def test_resumes_where_it_was(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / 'log'
    items = [f'open({str(log)!r}, "a").write("{number}") and 1 // {number}' for number in range(4)]
    loud = Where(jobs=1)
    first = map_items(eval, items[:2], tmp_path / 'results', where=loud)
    assert [outcome.result for outcome in first] == [None, 1]
    assert 'skipped open' in capsys.readouterr().err
    map_items(eval, items, tmp_path / 'results', where=loud)
    assert log.read_text() == '01' + '023', 'only what has no result yet'
    # A kept result belongs to its settings.
    map_items(eval, items[1:], tmp_path / 'results', key=lambda item: f'{item} other', where=loud)
    assert log.read_text() == '01' + '023' + '123'


def test_a_bag_that_changed_is_done_again(archive: Path, tmp_path: Path) -> None:
    bag = archive / 'extra'
    (before,) = map_bags(describe, [bag], tmp_path / 'results', where=QUIET)
    (kept,) = map_bags(describe, [bag], tmp_path / 'results', where=QUIET)
    assert kept == before
    shutil.rmtree(bag)
    write_session(bag, random_session(30))
    (after,) = map_bags(describe, [bag], tmp_path / 'results', where=QUIET)
    assert after.result != before.result


def test_a_scheduler_that_is_not_there_is_said(tmp_path: Path) -> None:
    pytest.importorskip('distributed', reason='Dask is an optional extra')
    with pytest.raises(StageError, match='no Dask scheduler answers'):
        map_items(eval, ['1'], tmp_path, where=Where(scheduler='tcp://127.0.0.1:9'))


def test_without_dask_it_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'distributed', None)
    with pytest.raises(StageError, match='pip install distributed'):
        map_items(eval, ['1'], tmp_path, where=Where(scheduler='tcp://127.0.0.1:9'))


def test_converters_write_session_bags(data_root: Path, tmp_path: Path) -> None:
    for module in (
        convert_xy_circle,
        convert_emps,
        convert_ess_tank,
        convert_odrive_cogging,
    ):
        assert module.main(['--out', str(tmp_path), '--data', str(data_root)]) == 0
    names = sorted(path.name for path in tmp_path.iterdir())
    assert len(names) == 18 and 'day2_b' in names and 'slow2_comp_2' in names
    for name in ('day1_a', 'emps', 'ess_tank_stroke', 'ess_tank_stops', 'slow2_nocomp_0'):
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
    # The pulses of the file are a declared input: half of every second, 5 V each.
    pushed = read_session(tmp_path / 'emps_pulses').series[topics.SETPOINT]
    assert len(pushed) == 12497 and 'velocity.x' in pushed.values
    emps = read_session(tmp_path / 'emps')
    assert not emps.has(topics.SETPOINT)
    assert emps.axes == ('x',)
    # The published least-squares model explains the recorded force to 4.1 % (Janot, Gautier,
    # Brunot, EMPS, 2019).
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


def test_a_record_without_an_array_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {
        convert_xy_circle: (
            'xy_circle/mine.npz',
            't, reference, encoder, command, contact_force',
        ),
        convert_emps: ('emps/DATA_EMPS.mat', 't, qg, qm, vir, kp, kv, gtau'),
        convert_ess_tank: ('ess_tank/stroke.npz', 'motor_t, motor, encoder_t, encoder'),
        convert_odrive_cogging: (
            'odrive_cogging/slow2_nocomp_0.npz',
            't, position, current',
        ),
    }
    for module, (name, needed) in files.items():
        file = tmp_path / name
        file.parent.mkdir()
        first, *missing = needed.split(', ')
        save = savemat if file.suffix == '.mat' else lambda path, arrays: np.savez(path, **arrays)
        save(file, {first: np.arange(9.0)})
        assert module.main(['--out', str(tmp_path / 'out'), '--data', str(tmp_path)]) == 2
        told = capsys.readouterr().err
        assert told == f'error: {file} lacks {", ".join(missing)}: it needs {needed}\n'
    for content in (b'PK\x03\x04 cut off', b'', b'no archive'):
        file.write_bytes(content)
        assert module.main(['--out', str(tmp_path / 'out'), '--data', str(tmp_path)]) == 2
        assert capsys.readouterr().err.startswith(f'error: cannot read {file}')


@pytest.mark.parametrize(
    ('name', 'wrong', 'told'),
    [
        ('t', lambda t: t[::-1], 't must hold 41 or more times that increase'),
        ('t', lambda t: t[:40], 't must hold 41 or more times that increase'),
        ('encoder', lambda q: q[:-1], 'encoder has 99 rows, its times t have 100'),
        ('command', lambda u: np.where(u > 0.5, np.nan, u), 'command is empty or holds'),
        ('reference', lambda r: r[:, :0], 'reference is empty or holds'),
        ('encoder', lambda q: q[:, :1], 'holds other arrays than those'),
    ],
)
def test_a_record_that_is_none_is_one_line(
    name: str,
    wrong: Callable[[np.ndarray], np.ndarray],
    told: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    rng = np.random.default_rng(0)
    arrays = {n: rng.uniform(size=(100, 2)) for n in ('reference', 'encoder', 'command')}
    arrays |= {'t': np.arange(100.0), 'contact_force': rng.uniform(size=(100, 2))}
    arrays[name] = wrong(arrays[name])
    (tmp_path / 'xy_circle').mkdir()
    np.savez(tmp_path / 'xy_circle' / 'mine.npz', **arrays, note=np.array('a text beside'))
    assert convert_xy_circle.main(['--out', str(tmp_path / 'out'), '--data', str(tmp_path)]) == 2
    assert told in capsys.readouterr().err
