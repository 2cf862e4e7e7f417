"""A bag in the Rerun viewer: what is read beside the arrays, and the recording it becomes."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from session_bags.definitions import typestore
from session_bags.writer import SessionWriter
from stage_bringup import rerun_view
from stage_bringup.rerun_content import read_recorded
from stage_core import topics

#: Simulated time begins at 1 s; this bag was recorded in 2026 at half of real time.
BEGIN, WALL = 1_000_000_000, 1_790_000_000_000_000_000
TICKS = 200
WORDS = ('at rest', 'moving', 'moving', 'at rest')


def message(kind: str, /, **fields: Any) -> Any:
    return typestore().types[kind](**fields)


def header(stamp: int, frame: str = '') -> Any:
    time = message('builtin_interfaces/msg/Time', sec=stamp // 10**9, nanosec=stamp % 10**9)
    return message('std_msgs/msg/Header', stamp=time, frame_id=frame)


def joints(stamp: int, x: float) -> Any:
    return message(
        'sensor_msgs/msg/JointState', header=header(stamp), name=['x', 'y'],
        position=np.array([x, 0.0]), velocity=np.array([]), effort=np.array([]),
    )  # fmt: skip


def point(stamp: int, x: float) -> Any:
    place = message('geometry_msgs/msg/Point', x=x, y=0.0, z=0.0)
    return message('geometry_msgs/msg/PointStamped', header=header(stamp, 'tracker'), point=place)


def alignment(stamp: int) -> Any:
    """Half a turn about z, then 1 m along x."""
    turned = message('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=1.0, w=0.0)
    away = message('geometry_msgs/msg/Vector3', x=1.0, y=0.0, z=0.0)
    transform = message('geometry_msgs/msg/Transform', translation=away, rotation=turned)
    return message(
        'geometry_msgs/msg/TransformStamped', header=header(stamp, 'stage'),
        child_frame_id='tracker', transform=transform,
    )  # fmt: skip


def diagnostics(stamp: int, text: str) -> Any:
    status = message(
        'diagnostic_msgs/msg/DiagnosticStatus', level=1 if text == 'moving' else 0,
        name='stage_driver: state', message=text, hardware_id='', values=[],
    )  # fmt: skip
    return message('diagnostic_msgs/msg/DiagnosticArray', header=header(stamp), status=[status])


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A session of 0.2 s in simulated time, which took 0.4 s."""
    path = tmp_path / 'calibration'
    with SessionWriter(path) as writer:

        def write(topic: str, stamp: int, content: Any) -> None:
            name = topics.TOPIC_TYPES[topic]
            data = bytes(typestore().serialize_cdr(content, name))
            writer.write(topic, data, stamp, WALL + 2 * (stamp - BEGIN))

        write(topics.ALIGNMENT, BEGIN, alignment(BEGIN))
        for tick in range(TICKS):
            stamp = BEGIN + tick * 1_000_000
            write(topics.REFERENCE, stamp, joints(stamp, 1e-3 * tick))
            write(topics.JOINT_STATES, stamp, joints(stamp, 1e-3 * tick - 2e-6))
            if tick % 50 == 0:
                write(topics.TRACKER_POINT, stamp, point(stamp, 1.0 - 1e-3 * tick))
                write(topics.DIAGNOSTICS, stamp, diagnostics(stamp, WORDS[tick // 50]))
        model = message('std_msgs/msg/String', data='{"active": true}')
        write(topics.MODEL, BEGIN + 150_000_000, model)
    return path


def test_both_clocks_and_rare_messages_are_read(bag: Path) -> None:
    found = read_recorded(bag)
    stamps = BEGIN + np.array([-1_000_000, 0, 10_000_001, 150_000_000, 151_000_000])
    since = [-1_000_000, 0, 20_000_002, 300_000_000, 301_000_000]
    assert (found.wall_time(stamps) - WALL).tolist() == since
    # A state that is said again is no news.
    assert [(n.level, n.text) for n in found.notes] == [
        ('INFO', 'at rest'), ('WARN', 'moving'), ('INFO', 'at rest'),
    ]  # fmt: skip
    (_, transform) = found.alignments[0]
    np.testing.assert_allclose(transform.apply((0.7, 0.0, 0.0)), (0.3, 0.0, 0.0), atol=1e-15)
    assert found.models == [(BEGIN + 150_000_000, '{"active": true}')]


def test_without_the_extra_one_line_says_how_to_install_it(
    bag: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, 'rerun', None)
    assert rerun_view.main(['--bag', str(bag), '--out', str(bag / 'session.rrd')]) == 2
    said = capsys.readouterr().err
    assert said.count('\n') == 1 and f'pip install {rerun_view.PINNED}' in said
    setup = Path(rerun_view.__file__).parents[1] / 'setup.py'
    assert f"'{rerun_view.PINNED}'" in setup.read_text()


def test_a_bag_becomes_a_recording_on_two_timelines(bag: Path) -> None:
    pytest.importorskip('rerun', reason='rerun-sdk is an optional extra')
    from rerun.chunk import RrdReader

    out = bag.parent / 'session.rrd'
    assert rerun_view.main(['--bag', str(bag), '--out', str(out)]) == 0
    reader = RrdReader(out)
    assert len(reader.blueprints()) == 1
    tables: dict[str, Any] = {}
    for chunk in reader.stream(store=reader.recordings()[0]):
        if not chunk.is_static:
            assert set(chunk.timeline_names) == {'session_time', 'wall_time'}
            tables.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())
    archetypes = {
        '/stage/tracker/point': 'Points3D:positions',
        '/stage/table': 'Points3D:positions',
        '/stage/tracker': 'Transform3D:quaternion',
        '/position_mm/encoder/x': 'Scalars:scalars',
        '/tracking_error/x': 'Scalars:scalars',
        '/diagnostics/stage_driver_state': 'TextLog:text',
        '/model': 'TextDocument:text',
    }
    for entity, column in archetypes.items():
        assert any(column in batch.schema.names for batch in tables[entity]), entity
    batches = tables['/tracking_error/x']
    errors = [v for b in batches for v in b.column('Scalars:scalars').to_pylist()]
    assert len(errors) == TICKS
    np.testing.assert_allclose(np.ravel(errors), 2.0, atol=1e-9)
    states = [
        state
        for batch in tables['/diagnostics/stage_driver_state']
        if 'StateChange:state' in batch.schema.names
        for state in np.ravel(batch.column('StateChange:state').to_pylist())
    ]
    assert states == ['at rest', 'moving', 'at rest']
    times = tables['/stage/tracker/point'][0]
    session = times.column('session_time').cast('int64').to_pylist()
    wall = times.column('wall_time').cast('int64').to_pylist()
    assert session == [0, 50_000_000, 100_000_000, 150_000_000]
    assert [w - WALL for w in wall] == [2 * s for s in session]
