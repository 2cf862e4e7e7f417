"""The reader against the writer and two independent readers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from session_bags.bag import open_bag
from session_bags.bulk import session_blocks
from session_bags.cdr import blank_layout, encode
from session_bags.reader import read_session
from session_bags.writer import SessionWriter, write_session
from stage_core import topics
from stage_core.errors import StageError
from stage_core.session import Series, Session

from .conftest import START, assert_same, random_session

STORE = get_typestore(Stores.ROS2_JAZZY)


def columns_of(message: object) -> dict[str, float]:
    """Columns of a decoded message, by the names of a series."""
    part = next(
        (getattr(message, n) for n in ('point', 'vector', 'wrench') if hasattr(message, n)),
        message,
    )
    if hasattr(part, 'position'):
        found = {}
        for quantity in ('position', 'velocity', 'effort'):
            values = getattr(part, quantity)
            found |= {f'{quantity}.{j}': v for j, v in zip(part.name, values, strict=False)}
        return found
    if hasattr(part, 'force'):
        return {
            f'{name}.{axis}': getattr(getattr(part, name), axis)
            for name in ('force', 'torque')
            for axis in 'xyz'
        }
    if hasattr(part, 'temperature'):
        return {'temperature': part.temperature, 'variance': part.variance}
    return {axis: getattr(part, axis) for axis in 'xyz'}


def collect(messages: object) -> dict[str, list[tuple[int, dict[str, float]]]]:
    found: dict[str, list[tuple[int, dict[str, float]]]] = {}
    for topic, message in messages:  # type: ignore[attr-defined]
        if topic == topics.ALIGNMENT:
            continue
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        key = topic
        if topic == topics.TEMPERATURE:
            key = topics.temperature_key(message.header.frame_id)
        found.setdefault(key, []).append((stamp, columns_of(message)))
    return found


def assert_equal(session: Session, found: dict[str, list[tuple[int, dict[str, float]]]]) -> None:
    found = {key: sorted(entries, key=lambda e: e[0]) for key, entries in found.items()}
    assert session.series.keys() == found.keys()
    for key, messages in found.items():
        series = session.series[key]
        assert series.stamps.tolist() == [stamp for stamp, _ in messages], key
        for name, column in series.values.items():
            other = [columns.get(name, np.nan) for _, columns in messages]
            np.testing.assert_array_equal(column, other, err_msg=f'{key} {name}')


@settings(max_examples=6, deadline=None)
@given(
    count=st.integers(1, 60),
    seed=st.integers(0, 1000),
    axes=st.sampled_from([('x', 'y'), ('x',)]),
    effort=st.booleans(),
)
def test_equal_to_rosbags_and_mcap_ros2(
    tmp_path_factory: pytest.TempPathFactory,
    count: int,
    seed: int,
    axes: tuple[str, ...],
    effort: bool,
) -> None:
    session = random_session(count, seed, axes, effort)
    path = write_session(tmp_path_factory.mktemp('bags') / 'bag', session)
    mine = read_session(path)
    assert_same(session, mine)
    with AnyReader([path]) as reader:
        decoded = [(c.topic, reader.deserialize(r, c.msgtype)) for c, _, r in reader.messages()]
    assert_equal(mine, collect(decoded))
    with open(path / f'{path.name}_0.mcap', 'rb') as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        both = [(c.topic, m) for _, c, _, m in reader.iter_decoded_messages()]
    assert_equal(mine, collect(both))


def test_metadata_has_all_that_rosbag2_reads(bag: Path) -> None:
    import yaml

    inner = yaml.safe_load((bag / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert inner['version'] == 9 and inner['storage_identifier'] == 'mcap'
    for key in ('duration', 'starting_time', 'message_count', 'compression_format', 'custom_data',
                'compression_mode', 'relative_file_paths', 'files', 'ros_distro'):  # fmt: skip
        assert key in inner
    for topic in inner['topics_with_message_count']:
        record = topic['topic_metadata']
        assert record['serialization_format'] == 'cdr'
        assert record['type_description_hash'].startswith('RIHS01_')
        latched = record['name'] in topics.LATCHED
        (qos,) = record['offered_qos_profiles']
        assert qos['durability'] == ('transient_local' if latched else 'volatile')
        assert qos['deadline'] == {'sec': 9223372036, 'nsec': 854775807}
    with open(bag / 'bag_0.mcap', 'rb') as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == 'ros2'
        summary = reader.get_summary()
        (metadata,) = reader.iter_metadata()
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count == inner['message_count']
    counted = {
        topic['topic_metadata']['name']: topic['message_count']
        for topic in inner['topics_with_message_count']
    }
    assert counted == {
        channel.topic: summary.statistics.channel_message_counts[number]
        for number, channel in summary.channels.items()
    }
    assert all(schema.encoding == 'ros2msg' for schema in summary.schemas.values())
    assert metadata.name == 'rosbag2' and 'serialized_metadata' in metadata.metadata


def test_live_writer_keeps_times_and_sequence(tmp_path: Path) -> None:
    from session_bags.messages import raw_messages

    data = bytes(
        STORE.serialize_cdr(STORE.types['std_msgs/msg/String']('hello'), 'std_msgs/msg/String')
    )
    with SessionWriter(tmp_path / 'bag', {'kind': 'servo'}, chunk_bytes=300) as writer:
        for k in range(50):
            writer.write(topics.MODEL, data, 1000 + k, 900 + k, k + 7)
        assert writer.counts == {topics.MODEL: 50}
    messages = list(raw_messages(open_bag(tmp_path / 'bag')))
    assert [(m.log_time, m.publish_time, m.sequence) for m in messages] == [
        (1000 + k, 900 + k, k + 7) for k in range(50)
    ]
    assert all(m.data == data for m in messages)
    with pytest.raises(StageError, match='exists already'):
        SessionWriter(tmp_path / 'bag')
    with pytest.raises(StageError, match='closed'):
        writer.add_topic(topics.REFERENCE)


def test_a_session_in_simulated_time_knows_its_date(tmp_path: Path) -> None:
    first = 1_795_471_828_442_919_356
    with SessionWriter(tmp_path / 'bag') as writer:
        for k in range(3):
            stamp = 7_278_000_000 + k
            text = STORE.types['std_msgs/msg/String']('model')
            data = bytes(STORE.serialize_cdr(text, 'std_msgs/msg/String'))
            writer.write(topics.MODEL, data, stamp, first + k, k)
    assert read_session(tmp_path / 'bag', topics=[topics.REFERENCE]).recorded_ns == first


def test_a_session_of_real_time_begins_with_its_first_message(tmp_path: Path) -> None:
    session = random_session(5)
    path = write_session(tmp_path / 'bag', session)
    earliest = min(int(series.stamps[0]) for series in session.series.values())
    assert read_session(path).recorded_ns == earliest


def test_twin_travels_with_the_bag(tmp_path: Path) -> None:
    from stage_core.twin_file import TwinFile

    twin = TwinFile.nominal_servo()
    path = write_session(tmp_path / 'bag', random_session(5), twin)
    found = read_session(path).twin
    assert found is not None and TwinFile.from_dict(found).to_dict() == twin.to_dict()
    # A bare file carries it too.
    assert read_session(path / 'bag_0.mcap').twin == found


@pytest.mark.parametrize('start, stop', [(0.1, 0.25), (None, 0.05), (0.75, None), (0.2, 0.2001)])
def test_a_part_is_read_from_its_chunks_only(
    tmp_path: Path, start: float | None, stop: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    from session_bags import records

    session = random_session(1000)
    with SessionWriter(tmp_path / 'bag') as writer:
        writer.write_blocks(session_blocks(session), chunk_bytes=8192)
    whole = read_session(tmp_path / 'bag')
    unpacked = []
    real = records.unpack_chunk
    monkeypatch.setattr(
        records, 'unpack_chunk', lambda raw, path: unpacked.append(1) or real(raw, path)
    )
    part = read_session(tmp_path / 'bag', start=start, stop=stop)
    first = whole.start_ns + (0 if start is None else round(start * 1e9))
    last = 1 << 62 if stop is None else whole.start_ns + round(stop * 1e9)
    for key, series in whole.series.items():
        expected = series.between(first, last)
        np.testing.assert_array_equal(part.series[key].stamps, expected.stamps, err_msg=key)
        for name, column in expected.values.items():
            np.testing.assert_array_equal(part.series[key].values[name], column)
    assert part.alignment is not None
    unpacked_part = len(unpacked)
    read_session(tmp_path / 'bag')
    assert unpacked_part < 0.75 * (len(unpacked) - unpacked_part)


def test_named_topics_only(bag: Path) -> None:
    part = read_session(bag, topics=[topics.REFERENCE, topics.TRACKER_POINT])
    assert part.series.keys() == {topics.REFERENCE, topics.TRACKER_POINT}
    assert part.alignment is not None
    with pytest.raises(StageError, match='/stage/command, which drives'):
        part.require(topics.COMMAND, 'drives')


def test_padding_and_many_layouts(tmp_path: Path) -> None:
    """Bytes that CDR leaves open may hold anything; frames may change from message to message."""
    rng = np.random.default_rng(3)
    stamps = START + np.arange(60) * 1_000_000
    layout = blank_layout('sensor_msgs/msg/JointState', 'stage', ('x',), ('position',))
    values = rng.normal(size=60)
    rows = encode(layout, stamps, {'position.x': values})
    used = layout.mask.copy()
    used[4:12] = 255
    for _, offset in layout.fields:
        used[offset : offset + 8] = 255
    free = used == 0
    assert free.any()
    rows[:, free] = rng.integers(0, 255, (60, int(free.sum())))
    with SessionWriter(tmp_path / 'bag') as writer:
        for stamp, row in zip(stamps, rows, strict=True):
            writer.write(topics.REFERENCE, row.tobytes() + bytes(int(stamp) % 4), int(stamp))
        for k, stamp in enumerate(stamps):
            sensor = blank_layout('sensor_msgs/msg/Temperature', f'sensor_{k}')
            row = encode(sensor, stamps[k : k + 1], {'temperature': np.array([float(k)])})
            writer.write(topics.TEMPERATURE, row.tobytes(), int(stamp))
    session = read_session(tmp_path / 'bag')
    np.testing.assert_array_equal(session.series[topics.REFERENCE].values['position.x'], values)
    assert len(session.temperatures()) == 60
    assert session.temperatures()['sensor_59'].values['temperature'][0] == 59.0


def test_messages_out_of_order_are_sorted_and_said(tmp_path: Path) -> None:
    session = random_session(20)
    reference = session.series[topics.REFERENCE]
    order = np.random.default_rng(0).permutation(20)
    shuffled = Series(
        topics.REFERENCE,
        reference.stamps[order],
        {k: v[order] for k, v in reference.values.items()},
    )
    from session_bags.bulk import blocks_of

    with SessionWriter(tmp_path / 'bag') as writer:
        for block in blocks_of(shuffled, topics.REFERENCE):
            for k, row in enumerate(block.rows):
                writer.write(topics.REFERENCE, row.tobytes(), START + k)
    found = read_session(tmp_path / 'bag')
    np.testing.assert_array_equal(found.series[topics.REFERENCE].stamps, reference.stamps)
    assert 'order of its stamps' in found.warnings[0]
