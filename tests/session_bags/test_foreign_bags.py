"""Bags of other recorders, and of machines with several clocks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as PlainWriter
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer

from session_bags.bag import open_bag
from session_bags.bulk import session_blocks
from session_bags.cdr import blank_layout, encode
from session_bags.definitions import definition, typestore
from session_bags.info import contents
from session_bags.reader import read_session
from session_bags.repair import repair
from session_bags.writer import SessionWriter, write_session
from stage_core import topics
from stage_core.session import Series

from .conftest import START, assert_same, random_session

SECOND = 1_000_000_000
STORE = typestore()


@pytest.mark.parametrize('reference', [True, False])
@pytest.mark.parametrize('shift', [3600, -3600])
def test_a_part_of_a_bag_with_topics_of_several_clocks(
    tmp_path: Path, reference: bool, shift: int
) -> None:
    """A sensor on a machine with another date, and an alignment of long ago."""
    session = random_session(500)
    force = session.series[topics.CONTACT_FORCE]
    shifted = Series(force.topic, force.stamps + shift * SECOND, force.values)
    session.series[topics.CONTACT_FORCE] = shifted
    if not reference:
        del session.series[topics.REFERENCE]
    old = blank_layout('geometry_msgs/msg/TransformStamped', 'stage', child_frame='tracker')
    (alignment,) = encode(old, np.array([START - 7200 * SECOND]), {'rotation.w': np.ones(1)})
    rows = []
    for block in session_blocks(session):
        late = shift * SECOND if block.topic == topics.CONTACT_FORCE else 0
        if block.topic != topics.ALIGNMENT:
            times = zip(block.times.tolist(), block.rows, strict=True)
            rows += [(t - late, block.topic, row.tobytes()) for t, row in times]
    with SessionWriter(tmp_path / 'bag', chunk_bytes=8192) as writer:
        writer.write(topics.ALIGNMENT, alignment.tobytes(), START)
        for time, topic, row in sorted(rows, key=lambda r: r[0]):
            writer.write(topic, row, time)
    whole = read_session(tmp_path / 'bag')
    for begin in (0.2, shift + 0.2, 0.0):
        part = read_session(tmp_path / 'bag', start=begin, stop=begin + 0.1)
        first = whole.start_ns + round(begin * 1e9)
        expected = {k: s.between(first, first + SECOND // 10) for k, s in whole.series.items()}
        assert {k: len(s) for k, s in part.series.items()} == {
            k: len(s) for k, s in expected.items()
        }


def write_plainly(source: Path, path: Path, **options: Any) -> None:
    """The messages of a bag in a bare file of the format's own writer."""
    writer = PlainWriter(str(path), chunk_size=4096, **options)
    writer.start('ros2')
    channels: dict[str, int] = {}
    with AnyReader([source]) as reader:
        for connection, time, raw in reader.messages():
            if connection.topic not in channels:
                text = definition(connection.msgtype)[0].encode()
                schema = writer.register_schema(connection.msgtype, 'ros2msg', text)
                channels[connection.topic] = writer.register_channel(
                    connection.topic, 'cdr', schema
                )
            writer.add_message(channels[connection.topic], time, bytes(raw), time)
    writer.finish()


@pytest.mark.parametrize('compression', list(CompressionType))
@pytest.mark.parametrize('chunked', [True, False])
def test_files_of_other_recorders(
    tmp_path: Path, compression: CompressionType, chunked: bool
) -> None:
    """Schemas inside chunks, lz4 or no compression, no chunks at all, no metadata.yaml."""
    session = random_session(80)
    path = tmp_path / 'other.mcap'
    source = write_session(tmp_path / 'bag', session)
    write_plainly(source, path, compression=compression, use_chunking=chunked)
    assert_same(session, read_session(path))


@pytest.mark.parametrize(
    'options',
    [
        {'repeat_schemas': False},
        {'repeat_channels': False},
        {'use_statistics': False},
        {'use_statistics': False, 'repeat_channels': False},
        {'use_statistics': False, 'index_types': IndexType.NONE},
        {'use_chunking': False},
    ],
)
def test_a_file_whose_summary_lacks_a_part_is_read_from_end_to_end(
    tmp_path: Path, options: dict[str, Any]
) -> None:
    session = random_session(80)
    path = tmp_path / 'other.mcap'
    write_plainly(write_session(tmp_path / 'bag', session), path, **options)
    again = read_session(path)
    assert_same(session, again)
    assert ['no complete index' in warning for warning in again.warnings] == [True]
    found = contents(open_bag(path))
    assert found.counts[topics.REFERENCE] == 80
    repair(path)
    assert not read_session(path).warnings


def test_sqlite_bag_and_big_endian_messages(tmp_path: Path) -> None:
    session = random_session(40)
    source = write_session(tmp_path / 'bag', session)
    with (
        AnyReader([source]) as reader,
        Writer(tmp_path / 'old', version=9, storage_plugin=StoragePlugin.SQLITE3) as writer,
    ):
        connections = {
            c.topic: writer.add_connection(c.topic, c.msgtype, typestore=STORE)
            for c in reader.connections
        }
        for number, (connection, time, raw) in enumerate(reader.messages()):
            message = reader.deserialize(raw, connection.msgtype)
            swapped = STORE.serialize_cdr(
                message, connection.msgtype, little_endian=bool(number % 3)
            )
            writer.write(connections[connection.topic], time, swapped)
    assert_same(session, read_session(tmp_path / 'old'))
    part = read_session(tmp_path / 'old', start=0.01, stop=0.02)
    assert len(part.series[topics.REFERENCE]) == 10
