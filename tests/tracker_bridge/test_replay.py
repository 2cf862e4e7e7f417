"""Points of a recorded session come again, with the stamps they had."""

import numpy as np
import pytest

from session_bags.writer import write_session
from stage_core import topics
from stage_core.errors import StageError
from stage_core.session import Series, Session
from tracker_bridge.bridge import Bridge
from tracker_bridge.sources.replay import ReplaySource

from ..patience import PATIENCE

START = 1_700_000_000_123_456_789


def bag(path, with_points=True):
    stamps = START + np.arange(50) * 10_000_000
    values = np.random.default_rng(0).normal(size=(3, 50))
    joints = {'position.x': values[0], 'velocity.x': values[1]}
    series = {topics.REFERENCE: Series(topics.REFERENCE, stamps, joints)}
    if with_points:
        columns = dict(zip('xyz', values, strict=True))
        series[topics.TRACKER_POINT] = Series(topics.TRACKER_POINT, stamps, columns)
    write_session(path, Session('recorded', series, None, None))
    return stamps, values


def test_replay_delivers_every_point_with_its_stamp(tmp_path):
    stamps, values = bag(tmp_path / 'session')
    samples = []
    source = ReplaySource(samples.append, tmp_path / 'session', rate=50.0)
    source.start()
    source.join(PATIENCE)
    assert not source.is_alive()
    bridge = Bridge(source_clock='ros')
    out = [pair for sample in samples for pair in bridge.process(sample)]
    assert [stamp for stamp, _ in out] == stamps.tolist()
    assert np.array_equal(np.array([point for _, point in out]).T, values)
    assert 'ended' in source.trouble


def test_replay_can_be_stopped(tmp_path):
    bag(tmp_path / 'session')
    samples = []
    source = ReplaySource(samples.append, tmp_path / 'session', rate=0.001)
    source.start()
    source.stop()
    assert not source.is_alive()
    assert len(samples) <= 1


def test_what_cannot_be_replayed_is_one_clear_error(tmp_path):
    with pytest.raises(StageError, match='parameter bag'):
        ReplaySource(print, '')
    with pytest.raises(StageError):
        ReplaySource(print, tmp_path / 'nothing')
    bag(tmp_path / 'empty', with_points=False)
    with pytest.raises(StageError, match='/tracker/point.*another session'):
        ReplaySource(print, tmp_path / 'empty')
