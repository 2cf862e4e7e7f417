"""What `check` finds in a bag."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from session_bags import check, info
from session_bags.bulk import session_blocks
from session_bags.cdr import blank_layout, encode
from session_bags.check import ERROR, OK, WARNING, check_bag
from session_bags.drops import DropCounter
from session_bags.reader import read_session
from session_bags.writer import SessionWriter, write_session
from stage_core import topics
from stage_core.session import Series, Session, by_topic
from stage_core.twin_file import TwinFile

from .conftest import START


def smooth_session() -> Session:
    """A good session: a circle, followed exactly."""
    count = 2000
    stamps = START + np.arange(count) * 1_000_000
    angle = np.linspace(0, 6, count)
    turn = 6 / (count - 1) * 1000.0
    path = 0.01 * np.column_stack([np.cos(angle), np.sin(angle)])
    rate = turn * path[:, ::-1] * [-1.0, 1.0]
    slow = stamps[::10]
    series = by_topic(
        Series.per_axis(topics.REFERENCE, stamps, position=path, velocity=rate),
        Series.per_axis(topics.JOINT_STATES, stamps, position=path, velocity=rate),
        Series.per_axis(topics.COMMAND, stamps, velocity=rate),
        Series.points(topics.TRACKER_POINT, slow, path[::10]),
    )
    series[topics.temperature_key('air')] = Series(
        topics.TEMPERATURE, slow, {'temperature': np.full(len(slow), 20.5)}
    )
    return Session('smooth', series, TwinFile.nominal_servo().to_dict())


def test_a_good_bag_is_a_session_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_session(tmp_path / 'bag', smooth_session())
    assert [f for f in check_bag(path) if f.level != OK] == []
    assert check.main([str(path)]) == 0
    out = capsys.readouterr().out
    assert 'is a session bag: 0 errors, 0 warnings' in out and 'mean 1000 Hz, usual' in out
    assert info.main([str(path)]) == 0
    assert 'Topic: /stage/reference' in capsys.readouterr().out


def test_check_tells_the_mean_rate_and_the_slowest_stretch(tmp_path: Path) -> None:
    session = smooth_session()
    series = session.series[topics.JOINT_STATES]
    stamps = series.stamps
    # From half a second on, for one second, nine of ten are lost: the usual step is the same.
    second = 1_000_000_000
    lost = abs(stamps - stamps[0] - second) <= second // 2
    kept = ~lost | (np.arange(len(stamps)) % 10 == 0)
    thinned = Series(
        series.topic, stamps[kept], {name: v[kept] for name, v in series.values.items()}
    )
    path = write_session(
        tmp_path / 'bag', Session('thin', {**session.series, topics.JOINT_STATES: thinned})
    )
    (said,) = (f.text for f in check_bag(path) if (f.about, f.level) == (topics.JOINT_STATES, OK))
    span = (stamps[-1] - stamps[0]) / second
    (mean,) = re.findall(r'mean ([\d.]+) Hz', said)
    assert float(mean) == pytest.approx((kept.sum() - 1) / span, rel=1e-3)
    assert 'usual step 1000 Hz' in said and 'slowest stretch 100 Hz for 1 s from 0.5 s' in said


def test_one_axis_is_enough(tmp_path: Path) -> None:
    session = smooth_session()
    one = {
        key: Series(s.topic, s.stamps, {k: v for k, v in s.values.items() if not k.endswith('.y')})
        for key, s in session.series.items()
    }
    path = write_session(tmp_path / 'bag', Session('one', one))
    assert [f for f in check_bag(path) if f.level != OK] == []


Break = Callable[[dict[str, Series]], None]


def scaled(topic: str, names: tuple[str, ...], factor: float) -> Break:
    def change(series: dict[str, Series]) -> None:
        for name in names:
            series[topic].values[name] = series[topic].values[name] * factor

    return change


def stamps_changed(change: Callable[[np.ndarray], np.ndarray]) -> Break:
    def apply(series: dict[str, Series]) -> None:
        old = series[topics.JOINT_STATES]
        series[topics.JOINT_STATES] = Series(old.topic, change(old.stamps.copy()), old.values)

    return apply


def without(topic: str) -> Break:
    return lambda series: series.__delitem__(topic)


def nameless(series: dict[str, Series]) -> None:
    for topic in (topics.REFERENCE, topics.JOINT_STATES, topics.COMMAND):
        series[topic] = Series(topic, series[topic].stamps, {})


def exchanged(series: dict[str, Series]) -> None:
    values = series[topics.TRACKER_POINT].values
    values['x'], values['y'] = values['y'], values['x']


def renamed(series: dict[str, Series]) -> None:
    old = series[topics.REFERENCE]
    values = {k.replace('.x', '.joint1'): v for k, v in old.values.items()}
    series[topics.REFERENCE] = Series(old.topic, old.stamps, values)


@pytest.mark.parametrize(
    ('breaks', 'level', 'text'),
    [
        (without(topics.REFERENCE), ERROR, '/stage/reference: is absent'),
        (without(topics.TRACKER_POINT), WARNING, '/tracker/point: is absent'),
        (renamed, ERROR, "names joint 'joint1'"),
        (nameless, ERROR, '/stage/joint_states: names no joint'),
        (
            scaled(topics.JOINT_STATES, ('position.x', 'velocity.x'), 1e3),
            WARNING,
            'travels 1e+03 times as far',
        ),
        (scaled(topics.REFERENCE, ('velocity.x',), 1e3), WARNING, 'times the derivative'),
        (
            scaled(topics.TRACKER_POINT, ('x', 'y'), 1e3),
            ERROR,
            '1000 times as far as the encoder',
        ),
        (exchanged, WARNING, 'x and y look exchanged'),
        (scaled(topics.TRACKER_POINT, ('y',), -1.0), WARNING, 'turned or mirrored'),
        (scaled('/stage/temperature:air', ('temperature',), 14.3), WARNING, 'room temperature'),
        (
            stamps_changed(lambda s: s + np.where(np.arange(len(s)) > 999, 10**9, 0)),
            WARNING,
            'gap',
        ),
        (stamps_changed(lambda s: np.repeat(s[::2], 2)), WARNING, 'repeat the stamp'),
        (scaled(topics.REFERENCE, ('position.x',), np.inf), ERROR, 'not a finite number'),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, breaks: Break, level: str, text: str) -> None:
    session = smooth_session()
    breaks(session.series)
    path = write_session(tmp_path / 'bag', session)
    found = [str(f) for f in check_bag(path) if f.level == level]
    assert any(text in line for line in found), found
    assert check.main([str(path), '-q']) == (1 if level == ERROR else 0)


def alignments(path: Path, *frames: tuple[str, str], w: float = 1.0) -> Path:
    """A bag with an alignment for each pair of frames, x = 1 m from the tracker to the stage."""
    with SessionWriter(path) as writer:
        for k, (frame, child) in enumerate(frames):
            layout = blank_layout('geometry_msgs/msg/TransformStamped', frame, child_frame=child)
            shift = -1.0 if frame == 'tracker' else 1.0
            columns = {'rotation.w': np.array([w]), 'translation.x': np.array([shift])}
            (row,) = encode(layout, np.array([START + k]), columns)
            writer.write(topics.ALIGNMENT, row.tobytes(), START + k)
    return path


def test_what_is_wrong_with_an_alignment_is_named(tmp_path: Path) -> None:
    found = [str(f) for f in check_bag(alignments(tmp_path / 'w', ('stage', 'tracker'), w=2.0))]
    assert any('no unit quaternion' in f for f in found), found
    found = [str(f) for f in check_bag(alignments(tmp_path / 'f', ('map', 'tracker')))]
    assert any("frame_id 'map' and child_frame_id 'tracker' should be" in f for f in found), found


def test_the_last_alignment_counts_with_its_own_frames(tmp_path: Path) -> None:
    one, other = ('stage', 'tracker'), ('tracker', 'stage')
    for number, frames in enumerate([(one, other, one), (one, other), (other, one, other)]):
        path = alignments(tmp_path / str(number), *frames)
        found = read_session(path, topics=[topics.ALIGNMENT]).alignment
        assert found is not None and found.translation[0] == 1.0


def test_a_topic_of_another_clock_is_named(tmp_path: Path) -> None:
    session = smooth_session()
    old = session.series[topics.TRACKER_POINT]
    session.series[topics.TRACKER_POINT] = Series(old.topic, old.stamps + 10**17, old.values)
    path = write_session(tmp_path / 'bag', session)
    found = [str(f) for f in check_bag(path) if f.level == WARNING]
    assert any('/tracker/point: is stamped 1e+08 s from the reference' in f for f in found), found
    assert any('another clock than the rest' in f for f in found), found


def test_findings_about_the_container(tmp_path: Path) -> None:
    from session_bags.bulk import blocks_of

    session = smooth_session()
    with SessionWriter(tmp_path / 'bag', {'kind': 'nonsense'}) as writer:
        writer.add_topic('/stage/refrence', 'sensor_msgs/msg/JointState')
        writer.add_topic(topics.MODEL, latched=False)
        writer.add_topic(topics.CONTACT_FORCE, 'geometry_msgs/msg/PointStamped')
        writer.write_blocks(session_blocks(session))
        (block,) = blocks_of(session.series[topics.REFERENCE], topics.REFERENCE)
        # One message at the end that comes late and was preceded by two lost ones.
        writer.write(topics.REFERENCE, block.rows[5].tobytes(), START + 3 * 10**9, sequence=2003)
    text = '\n'.join(str(finding) for finding in check_bag(tmp_path / 'bag'))
    for expected in (
        'twin is no twin file',
        '/stage/refrence: is no topic of a session',
        '/calibrator/model: is not latched',
        '/stage/contact_force: is of type geometry_msgs/msg/PointStamped',
        '/stage/reference: 2 messages were dropped',
        '/stage/reference: stamps go back in time',
    ):
        assert expected in text, text


@pytest.mark.parametrize(
    ('numbers', 'dropped'),
    [([1, 2, 3], 0), ([5, 6, 9, 10], 2), ([7, 8, 1, 2], 0), ([1, 4, 1, 3], 3), ([], 0)],
)
def test_drop_counter(numbers: list[int], dropped: int) -> None:
    counter = DropCounter()
    for number in numbers:
        counter.add(number)
    assert counter.received == len(numbers) and counter.known_drops == dropped
    counter.several_publishers = True
    assert counter.known_drops is None
