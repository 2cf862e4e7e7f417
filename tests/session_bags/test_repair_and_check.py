"""Truncation, corruption, kills and full disks; the checker's findings."""

from __future__ import annotations

import errno
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer as PlainWriter
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from session_bags import info, metadata, repair
from session_bags.bulk import session_blocks
from session_bags.check import check_bag
from session_bags.definitions import typestore
from session_bags.reader import read_session
from session_bags.records import ChunkPlace, chunk_messages
from session_bags.writer import SessionWriter
from stage_core import topics
from stage_core.errors import StageError
from stage_core.session import Session

from .conftest import assert_same, random_session

#: A failing example is small as it is, and each costs a bag.
NO_SHRINKING = (Phase.explicit, Phase.generate)


class Example:
    """An mcap file and its session; short when hypothesis prints it."""

    def __init__(self, data: bytes, session: Session) -> None:
        self.data, self.session = data, session

    def __repr__(self) -> str:
        return f'Example({len(self.data)} bytes)'


@pytest.fixture(scope='module')
def example(tmp_path_factory: pytest.TempPathFactory) -> Example:
    """An mcap file of several chunks, and its session."""
    session = random_session(300)
    path = tmp_path_factory.mktemp('bags') / 'bag'
    with SessionWriter(path, session.twin) as writer:
        writer.write_blocks(session_blocks(session), chunk_bytes=16_384)
    return Example((path / 'bag_0.mcap').read_bytes(), session)


def bag_with(data: bytes, folder: Path) -> Path:
    """A bag whose recorder was killed: the file, and a provisional description."""
    SessionWriter(folder / 'bag', {'kind': 'servo'})
    (folder / 'bag' / 'bag_0.mcap').write_bytes(data)
    return folder / 'bag'


def prefix_of(part: Session, whole: Session) -> None:
    """Every series of `part` begins that of `whole`, bit for bit."""
    for key, series in part.series.items():
        expected = whole.series[key]
        assert len(series) <= len(expected)
        np.testing.assert_array_equal(series.stamps, expected.stamps[: len(series)])
        for name, column in series.values.items():
            np.testing.assert_array_equal(column, expected.values[name][: len(series)])


@settings(
    max_examples=12, deadline=None, phases=NO_SHRINKING, suppress_health_check=list(HealthCheck)
)
@given(share=st.floats(0, 1))
def test_truncated_anywhere(
    example: Example, tmp_path_factory: pytest.TempPathFactory, share: float
) -> None:
    data, session = example.data, example.session
    bag = bag_with(data[: int(share * len(data))], tmp_path_factory.mktemp('cut'))
    try:
        part = read_session(bag)
    except StageError:
        assert share < 0.2, 'no complete chunk is left only near the beginning'
        return
    prefix_of(part, session)
    repair.repair(bag)
    again = read_session(bag)
    assert not again.warnings and again.twin is not None
    assert_same(part, again)
    with AnyReader([bag]) as reader:
        counts = Counter(connection.topic for connection, _, _ in reader.messages())
        count = counts.total()
        assert counts == Counter({t.name: t.count for t in metadata.load(bag).topics})
        assert (
            count == reader.message_count == sum(info.contents(info.open_bag(bag)).counts.values())
        )
    # The format's own reader, whose summary and checksums Foxglove relies on.
    (file,) = bag.glob('*.mcap')
    with open(file, 'rb') as stream:
        plain = make_reader(stream, validate_crcs=True)
        summary = plain.get_summary()
        assert summary is not None and summary.statistics is not None
        assert summary.statistics.message_count == count == sum(1 for _ in plain.iter_messages())


@settings(
    max_examples=25, deadline=None, phases=NO_SHRINKING, suppress_health_check=list(HealthCheck)
)
@given(place=st.floats(0, 1), value=st.integers(0, 255), length=st.integers(1, 40))
def test_corrupted_anywhere(
    example: Example,
    tmp_path_factory: pytest.TempPathFactory,
    place: float,
    value: int,
    length: int,
) -> None:
    """Nothing but a StageError escapes, and what a repair keeps reads cleanly."""
    data = bytearray(example.data)
    begin = int(place * (len(data) - length))
    data[begin : begin + length] = bytes([value]) * length
    bag = bag_with(bytes(data), tmp_path_factory.mktemp('bad'))
    for use in (read_session, check_bag, info.describe):
        try:
            use(bag)
        except StageError as error:
            assert str(bag) in str(error) or 'bag' in str(error)
    try:
        repair.repair(bag)
    except StageError:
        return
    read_session(bag, allow_nan=True)


FULL = """
import resource, signal, sys
sys.path.insert(0, sys.argv[2])
from session_bags.bulk import session_blocks
from session_bags.writer import SessionWriter
from stage_core.errors import command_line
from tests.session_bags.conftest import random_session
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
@command_line
def main():
    writer = SessionWriter(sys.argv[1])
    blocks = session_blocks(random_session(3000))
    limit = int(sys.argv[3])
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    with writer:
        writer.write_blocks(blocks, chunk_bytes=20000)
sys.exit(main())
"""


@pytest.mark.parametrize('limit', [100_000, 103_000, 111_111])
def test_full_disk(tmp_path: Path, limit: int) -> None:
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(
        [sys.executable, '-c', FULL, str(tmp_path / 'bag'), str(root), str(limit)],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert 'free space' in done.stderr and 'Traceback' not in done.stderr
    session = read_session(tmp_path / 'bag')
    assert f'the {sum(len(s) for s in session.series.values()) + 1} messages' in done.stderr
    prefix_of(session, random_session(3000))


def test_a_disk_that_is_full_when_the_file_is_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The index fits and `metadata.yaml` does not: the same clear error, and a bag to repair."""
    writer = SessionWriter(tmp_path / 'bag')
    writer.write_blocks(session_blocks(random_session(3000)))

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, 'No space left on device')

    with monkeypatch.context() as patch:
        patch.setattr('session_bags.metadata.BagMetadata.save', full)
        with pytest.raises(StageError, match='free space'):
            writer.close()
    assert repair.main([str(tmp_path / 'bag')]) == 0
    assert_same(read_session(tmp_path / 'bag'), random_session(3000))


@pytest.mark.parametrize('left', [0, 60])
def test_a_bag_of_several_files_is_repaired_without_the_file_that_holds_nothing(
    example: Example, tmp_path: Path, left: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """A recorder was killed as it began the next file."""
    bag = tmp_path / 'bag'
    bag.mkdir()
    (bag / 'bag_9.mcap').write_bytes(example.data)
    (bag / 'bag_10.mcap').write_bytes(example.data)
    (bag / 'bag_11.mcap').write_bytes(example.data[:left])
    assert len(read_session(bag).series[topics.REFERENCE]) == 600
    assert repair.main([str(bag)]) == 0
    assert 'bag_11.mcap: no complete chunk' in capsys.readouterr().out
    description = metadata.load(bag)
    assert description and [f.path for f in description.files] == ['bag_9.mcap', 'bag_10.mcap']
    assert not any('unfinished' in warning for warning in read_session(bag).warnings)


def test_a_channel_without_a_schema_is_no_hindrance(tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    bag.mkdir()
    writer = PlainWriter(str(bag / 'bag_0.mcap'))
    writer.start()
    writer.add_message(writer.register_channel('/panel', 'json', 0), 5, b'{}', 5)
    writer.finish()
    (done,) = repair.repair(bag)
    assert done.was_whole and info.contents(info.open_bag(bag)).counts == {'/panel': 1}


def test_a_bag_of_compressed_messages_is_left_as_it_is(bag: Path, tmp_path: Path) -> None:
    other = tmp_path / 'other'
    writer = Writer(other, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with AnyReader([bag]) as reader, writer:
        known = {
            c.topic: writer.add_connection(c.topic, c.msgtype, typestore=typestore())
            for c in reader.connections
        }
        for connection, time, raw in reader.messages():
            writer.write(known[connection.topic], time, raw)
    with pytest.raises(StageError, match='compressed messages'):
        repair.repair(other)
    assert_same(read_session(bag), read_session(other))


def test_a_disk_without_hard_links(
    example: Example, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a USB stick formatted for Windows."""

    def refused(*_: object) -> None:
        raise PermissionError(errno.EPERM, 'Operation not permitted')

    monkeypatch.setattr('os.link', refused)
    bag = bag_with(example.data[:40_000], tmp_path)
    (done,) = repair.repair(bag)
    assert done.messages and not read_session(bag).warnings
    assert (bag / 'bag_0.mcap.unfinished').read_bytes() == example.data[:40_000]


def test_a_damaged_chunk_of_an_unfinished_bag_costs_that_chunk_only(tmp_path: Path) -> None:
    with SessionWriter(tmp_path / 'bag') as writer:
        writer.write_blocks(session_blocks(random_session(500)), chunk_bytes=20_000)
    (file,) = (tmp_path / 'bag').glob('*.mcap')
    index = info.open_bag(tmp_path / 'bag').files[0]
    third, last = index.chunks[2], index.chunks[-1]
    counts = [len(chunk_rows(file, place)) for place in index.chunks]
    assert len(counts) > 5
    data = bytearray(file.read_bytes()[: last.offset + last.length])
    data[third.offset + third.length // 2] ^= 0xFF
    data[last.offset + last.length // 2] ^= 0xFF
    file.write_bytes(data)
    with pytest.raises(StageError, match='repair'):
        read_session(tmp_path / 'bag')
    (done,) = repair.repair(tmp_path / 'bag')
    assert done.lost_chunks == 1 and done.lost_bytes == last.length
    assert done.messages == sum(counts) - counts[2] - counts[-1]
    assert not read_session(tmp_path / 'bag').warnings


def chunk_rows(file: Path, place: ChunkPlace) -> list[int]:
    with open(file, 'rb') as stream:
        _, found = chunk_messages(stream, file, place)
    return [number for channel, rows in found.items() for number in [channel] * len(rows)]


def test_a_bag_that_is_still_recorded_is_not_repaired(tmp_path: Path) -> None:
    """The recorder would go on in the file that the repair has put aside."""
    blocks = session_blocks(random_session(100))
    with SessionWriter(tmp_path / 'bag') as writer:
        writer.write_blocks(blocks)
        with pytest.raises(StageError, match='still recorded'):
            repair.repair(tmp_path / 'bag')
        writer.write_blocks(blocks)
    (done,) = repair.repair(tmp_path / 'bag')
    assert done.was_whole and done.messages == 2 * sum(len(b.times) for b in blocks)


def test_repair_says_what_it_did(
    example: Example, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = bag_with(example.data[:40_000], tmp_path)
    assert repair.main([str(bag)]) == 0
    assert 'repaired' in capsys.readouterr().out
    assert repair.main([str(bag)]) == 0
    assert 'whole' in capsys.readouterr().out
    assert repair.main([str(tmp_path / 'nothing')]) == 2
    assert 'error: ' in capsys.readouterr().err
