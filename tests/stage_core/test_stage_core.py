"""Frames, stamps, twin files, parameters and the drive link."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stage_core import drive_link
from stage_core.clocks import to_seconds, to_stamps
from stage_core.errors import StageError, command_line
from stage_core.frames import RigidTransform, fit_rigid
from stage_core.parameters import Parameter, check
from stage_core.quantities import split_effect
from stage_core.session import Series, Session, by_topic
from stage_core.twin_file import ServoAxis, TwinFile

SMALL = settings(max_examples=40, deadline=None)


@SMALL
@given(st.integers(0, 2**31))
def test_rigid_fit_agrees_with_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(random_state=seed % 2**31)
    points = rng.uniform(-0.2, 0.2, (12, 3))
    shift = rng.uniform(-5, 5, 3)
    measured = rotation.apply(points) + shift + rng.normal(0, 1e-6, points.shape)
    found = fit_rigid(points, measured)
    oracle, _ = Rotation.align_vectors(
        measured - measured.mean(axis=0), points - points.mean(axis=0)
    )
    np.testing.assert_allclose(found.rotation, oracle.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(found.inverse().apply(found.apply(points)), points, atol=1e-12)


def test_rigid_fit_of_a_plane_is_a_rotation() -> None:
    points = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]], dtype=float)
    rotation = Rotation.from_euler('xyz', [0.1, -0.2, 2.0]).as_matrix()
    found = fit_rigid(points, points @ rotation.T + 1.0)
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-12)


@pytest.mark.parametrize(
    ('points', 'words'),
    [
        (np.zeros((2, 3)), 'three pairs'),
        (np.outer(np.arange(5), [1.0, 2.0, 0.0]), 'one line'),
        (np.full((4, 3), np.nan), 'not a number'),
    ],
)
def test_rigid_fit_refuses(points: np.ndarray, words: str) -> None:
    with pytest.raises(StageError, match=words):
        fit_rigid(points, points)


@SMALL
@given(st.integers(0, 2**31))
def test_quaternion_round_trip(seed: int) -> None:
    rotation = Rotation.random(random_state=seed % 2**31).as_matrix()
    transform = RigidTransform(rotation, np.array([1.0, 2.0, 3.0]))
    back = RigidTransform.from_quaternion(transform.quaternion(), transform.translation)
    np.testing.assert_allclose(back.rotation, rotation, atol=1e-12)


def test_seconds_keep_nanoseconds_at_an_epoch() -> None:
    start = 1_795_000_000_123_456_789
    stamps = start + np.array([0, 1, 1_000_001], dtype=np.int64)
    np.testing.assert_allclose(to_seconds(stamps, start), [0.0, 1e-9, 0.001000001], rtol=1e-15)
    np.testing.assert_array_equal(to_stamps(to_seconds(stamps, start), start), stamps)


def test_twin_file_round_trip() -> None:
    nominal = TwinFile.nominal_servo()
    assert nominal.servo('x') == ServoAxis(18.0, 40.0)
    text = nominal.with_effects({'backlash.x': {'width': 1.2e-5}}).to_yaml()
    again = TwinFile.from_dict(yaml.safe_load(text))
    assert again.effects == {'backlash.x': {'width': 1.2e-5}}
    assert again.axes == nominal.axes
    assert again.tracker == nominal.tracker


def test_numbers_without_a_dot_are_numbers() -> None:
    content = yaml.safe_load('{kind: servo, axes: {x: {mass: 18, viscous: 40, lead: 1e-2}}}')
    assert TwinFile.from_dict(content).servo('x').lead == 0.01


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        ({'kind': 'hydraulic'}, 'kind'),
        ({'kind': 'servo'}, 'axes'),
        ({'kind': 'servo', 'axes': {'z': {}}}, 'axes.z'),
        ({'kind': 'servo', 'axes': {'x': {'mass': 1.0}}}, 'viscous'),
        ({'kind': 'servo', 'axes': {'x': {'mass': -1.0, 'viscous': 1.0}}}, 'axes.x.mass'),
        ({'kind': 'servo', 'axes': {'x': {'mass': 'nan', 'viscous': 1.0}}}, 'finite'),
        (
            {'kind': 'servo', 'axes': {'x': {'mass': 1, 'viscous': 1}}, 'effects': {'a': 1}},
            'effects.a',
        ),
        ({'kind': 'servo', 'axes': {'x': {'mas': 1.0}}}, 'axes.x.mas is unknown: did you mean m'),
        (
            {'kind': 'servo', 'axes': {'x': {'mass': 1, 'viscous': 1, 'velocty_gain': 9}}},
            'axes.x.velocty_gain is unknown: did you mean velocity_gain',
        ),
        ({'kind': 'stepper', 'axes': {'x': {'mass': 1}}}, 'axes.x.mass is unknown: known are'),
        (
            {'kind': 'stepper', 'axes': {'x': {}}, 'tracker': {'nois': 1e-6}},
            'tracker.nois is unknown: did you mean noise',
        ),
        ({'kind': 'stepper', 'axes': {'x': {}}, 'control_peroid': 1}, 'did you mean control_p'),
    ],
)
def test_bad_twin_file_names_the_key(content: dict, words: str) -> None:
    with pytest.raises(StageError, match=words):
        TwinFile.from_dict(content)


def test_who_closes_the_loop_asks_for_gains(tmp_path: Path) -> None:
    content = TwinFile.nominal_servo().to_dict()
    content['axes']['y'].pop('velocity_gain')
    path = tmp_path / 'twin.yaml'
    path.write_text(yaml.safe_dump(content))
    assert TwinFile.load(path).servo('y').velocity_gain == ServoAxis(1.0, 1.0).velocity_gain
    with pytest.raises(StageError, match='axes.y.velocity_gain is missing'):
        TwinFile.load(path, with_gains=True)


def test_a_rig_keeps_the_gains_that_nobody_uses() -> None:
    content = {**TwinFile.nominal_servo().to_dict(), 'kind': 'measured_force'}
    assert TwinFile.from_dict(content).axes['x'].mass == 18.0


@pytest.mark.parametrize(
    ('value', 'words'),
    [(3.0, 'lie in'), (float('nan'), 'finite'), ('fast', 'type float'), (True, 'type float')],
)
def test_parameter_check(value: object, words: str) -> None:
    feed = Parameter('feed', 1.0, 'feed along the contour', 'm/s', 0.0, 2.0)
    assert check(feed, 2) is None
    assert words in str(check(feed, value))


def test_effect_names() -> None:
    assert split_effect('backlash.x') == ('backlash', 'x')
    assert split_effect('tracker_latency') == ('tracker_latency', None)


@SMALL
@given(
    st.integers(0, 2**60),
    st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=2),
    st.lists(st.floats(-50, 90), max_size=4),
)
def test_drive_link_round_trip(tick: int, positions: list, temperatures: list) -> None:
    data = drive_link.encode_encoder(tick, tick + 5, tuple(positions), tuple(temperatures), 1)
    found = drive_link.decode(data)
    assert found.values == tuple(positions) and found.temperatures == tuple(temperatures)
    assert (found.tick, found.stamp, found.flags) == (tick, tick + 5, 1)
    force = drive_link.decode(drive_link.encode_force(tick, 1, tuple(positions)))
    assert force.kind == drive_link.FORCE and force.values == tuple(positions)


def test_session_names_what_is_missing() -> None:
    stamps = np.arange(3, dtype=np.int64)
    series = Series('/stage/reference', stamps, {'position.x': np.zeros(3)})
    session = Session('bag', {'/stage/reference': series})
    assert session.axes == ('x',)
    with pytest.raises(StageError, match='/tracker/point'):
        session.table_points()
    with pytest.raises(StageError, match='velocity'):
        series.columns('velocity', ('x',))


def test_series_of_arrays_have_a_column_for_each_axis():
    stamps, rows = np.arange(3), np.arange(6.0).reshape(3, 2)
    joints = Series.per_axis('/stage/command', stamps, ('y', 'x'), velocity=rows, effort=-rows)
    assert list(joints.values) == ['velocity.y', 'velocity.x', 'effort.y', 'effort.x']
    np.testing.assert_array_equal(joints.columns('effort', ('y', 'x')), -rows)
    points = Series.points('/tracker/point', stamps, rows[:, :1])
    assert [column.tolist() for column in points.values.values()] == [[0, 2, 4], [0] * 3, [0] * 3]
    assert by_topic(joints, points) == {'/stage/command': joints, '/tracker/point': points}


def test_command_line_prints_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    @command_line
    def main() -> int:
        raise StageError('no such\nbag')

    assert main() == 2
    assert capsys.readouterr().err == 'error: no such bag\n'


def test_a_command_line_whose_disk_is_full_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    @command_line
    def main() -> None:
        with Path('/dev/full').open('w') as file:
            file.write('result')

    assert main() == 2
    assert 'No space left on device: make room and run it again' in capsys.readouterr().err
