"""Training from an archive of bags: the same everywhere, resumable, bad bags skipped."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibrator.gather import gather
from calibrator.prepare import prepare
from calibrator.restarts import train_restarts
from calibrator.retrain_offline import main
from calibrator.samples import concatenate
from calibrator.training import train
from session_bags.archive import Where
from session_bags.reader import read_session
from session_bags.writer import write_session
from stage_core import topics
from stage_core.errors import StageError

BAGS = 6


@pytest.fixture
def archive(tmp_path: Path, grid_session) -> Path:
    """Six sessions of one stage, two of them namesakes, and a file that is no bag."""
    folder = tmp_path / 'archive'
    for number in range(BAGS):
        name = f'day_{number // 2}/session_{number % 2}'
        write_session(folder / name, grid_session(12, rest=0.2, seed=number))
    (folder / 'bad').mkdir()
    (folder / 'bad' / 'bad.mcap').write_bytes(b'no mcap')
    return folder


def same_samples(first, second) -> bool:
    names = ('command', 'measured', 'direction', 'temperatures', 'times')
    return all(np.array_equal(getattr(first, n), getattr(second, n)) for n in names) and (
        (first.sensors, first.axes, first.shift) == (second.sensors, second.axes, second.shift)
    )


def test_every_place_gives_the_same_samples(
    archive: Path, tmp_path: Path, dask_cluster: str
) -> None:
    direct = concatenate(
        [prepare(read_session(archive / f'day_{n // 2}/session_{n % 2}')) for n in range(BAGS)]
    )
    places = {
        'processes': Where(jobs=2, progress=False),
        'cluster': Where(scheduler=dask_cluster, progress=False),
    }
    found = [gather([str(archive)], 'reference', 'tracker')]
    for name, where in places.items():
        found.append(gather([str(archive)], 'reference', 'tracker', tmp_path / name, where))
    for gathered in found:
        assert same_samples(gathered.samples, direct)
        assert len(gathered.bags) == BAGS
        assert list(gathered.skipped) == [str(archive / 'bad')]
    with pytest.raises(StageError):
        # A bag that is named is wanted.
        gather([str(archive / 'bad')], 'reference', 'tracker')


def measured_beside(session, offset: float):
    """The session with the tracker's x off by an offset [m]."""
    points = session.series[topics.TRACKER_POINT]
    moved = replace(points, values={**points.values, 'x': points.values['x'] + offset})
    return replace(session, series={**session.series, topics.TRACKER_POINT: moved})


def test_kept_samples_hold_the_derivatives_of_temperatures(
    tmp_path: Path, warming_session
) -> None:
    for name, offset in (('first', 0.0), ('second', 1e-6)):
        session = measured_beside(warming_session, offset)
        write_session(tmp_path / 'bags' / name, session)
    expected = prepare(warming_session).rates
    assert expected is not None and np.ptp(expected) > 0.0
    for _ in range(2):  # read from the bags, then from what was kept
        gathered = gather(
            [str(tmp_path / 'bags')],
            'reference',
            'tracker',
            tmp_path / 'kept',
            Where(jobs=1, progress=False),
        )
        assert not gathered.skipped
        np.testing.assert_array_equal(gathered.samples.rates, np.concatenate([expected] * 2))


def test_restarts_take_the_least_training_error(
    tmp_path: Path, grid_session, dask_cluster: str
) -> None:
    samples = prepare(grid_session(40))
    options = {'particles': 6, 'iterations': 4, 'rules': 2}
    alone = [train(samples, 'it2fls', {**options, 'seed': s}, 2) for s in (2, 3, 4)]
    values = [training.train_after.rms for training in alone]
    assert len(set(values)) == 3
    wanted = alone[int(np.argmin(values))]
    for name, where in (
        ('here', Where(jobs=1, progress=False)),
        ('cluster', Where(scheduler=dask_cluster, progress=False)),
    ):
        best, each = train_restarts(
            samples, 'it2fls', options, 2, 'position', 3, tmp_path / name, where
        )
        assert list(each) == values
        assert best.model.to_dict() == wanted.model.to_dict()
        assert best.metrics() == wanted.metrics()
    with pytest.raises(StageError, match='no random start'):
        train_restarts(samples, 'affine', {}, 0, 'position', 2, tmp_path)


def test_restarts_on_the_command_line(
    archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ['--bag', str(archive), '--method', 'it2fls', '--restarts', '2', '--jobs', '1']
    arguments += ['--options', json.dumps({'particles': 6, 'iterations': 3, 'rules': 2})]
    assert main([*arguments, '--results', str(tmp_path / 'results')]) == 0
    captured = capsys.readouterr()
    assert 'training RMS from 2 starts' in captured.out
    assert captured.err.count('skipped') == 1 and 'bad' in captured.err


def test_a_contour_among_the_bags_of_a_folder_is_skipped(tmp_path: Path, grid_session) -> None:
    for name, rest in (('calibration', 0.2), ('circle', 0.0)):
        write_session(tmp_path / name, grid_session(20, rest=rest))
    gathered = gather([str(tmp_path)], 'reference', 'tracker')
    assert [bag.name for bag in gathered.bags] == ['calibration']
    [(skipped, reason)] = gathered.skipped.items()
    assert skipped == str(tmp_path / 'circle') and 'this is no calibration' in reason
    with pytest.raises(StageError, match='this is no calibration'):
        gather([str(tmp_path / 'circle')], 'reference', 'tracker')


def test_a_copy_of_a_session_is_no_second_session(tmp_path: Path, capsys, grid_session) -> None:
    bag = write_session(tmp_path / 'bags' / 'bag', grid_session(40))
    shutil.copytree(bag, tmp_path / 'bags' / 'copy')
    gathered = gather([str(tmp_path / 'bags')], 'reference', 'tracker')
    assert [found.name for found in gathered.bags] == ['bag']
    assert gathered.samples.session is None
    [reason] = gathered.skipped.values()
    assert reason == f'it holds the same measurements as {bag}'
    twice = gather([str(bag), str(bag)], 'reference', 'tracker')
    assert twice.samples.session is None and len(twice.samples) == len(gathered.samples)
    assert main(['--bag', str(bag), '--holdout', str(tmp_path / 'bags' / 'copy')]) == 2
    assert 'copy was trained on: hold out another session' in capsys.readouterr().err
