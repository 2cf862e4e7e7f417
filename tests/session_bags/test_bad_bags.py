"""What is wrong with a bag is one error that names the thing and the remedy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from session_bags import info
from session_bags.bulk import session_blocks
from session_bags.cdr import JOINT_STATE, NUMERIC_TYPES, blank_layout, encode
from session_bags.definitions import typestore
from session_bags.metadata import load
from session_bags.reader import read_session
from session_bags.writer import SessionWriter, write_session
from stage_core import topics
from stage_core.errors import StageError

from .conftest import START, assert_same, random_session


class TestBadInput:
    """Each is one StageError that names the thing and the remedy."""

    def test_no_bag(self, tmp_path: Path) -> None:
        with pytest.raises(StageError, match='does not exist'):
            read_session(tmp_path / 'nothing')
        with pytest.raises(StageError, match='holds no bag'):
            read_session(tmp_path)
        (tmp_path / 'text.mcap').write_text('hello, this is no bag at all')
        with pytest.raises(StageError, match='not an mcap file'):
            read_session(tmp_path / 'text.mcap')

    def test_no_message(self, tmp_path: Path) -> None:
        SessionWriter(tmp_path / 'bag').close()
        with pytest.raises(StageError, match='holds no message'):
            read_session(tmp_path / 'bag')
        with SessionWriter(tmp_path / 'empty') as writer:
            writer.add_topic(topics.REFERENCE)
        with pytest.raises(StageError, match='holds no message'):
            read_session(tmp_path / 'empty')

    def test_one_message(self, tmp_path: Path) -> None:
        path = write_session(tmp_path / 'bag', random_session(1))
        assert len(read_session(path).series[topics.REFERENCE]) == 1

    def test_not_a_number(self, tmp_path: Path) -> None:
        session = random_session(30)
        session.series[topics.TRACKER_POINT].values['y'][2] = np.nan
        path = write_session(tmp_path / 'bag', session)
        with pytest.raises(StageError, match=r'/tracker/point holds .*\(y at stamp'):
            read_session(path)
        assert_same(session, read_session(path, allow_nan=True))
        read_session(path, topics=[topics.REFERENCE])

    def test_a_stranger_that_is_not_a_number(self, tmp_path: Path) -> None:
        """As the joint states of a robot whose controller knows no efforts."""
        layout = blank_layout(JOINT_STATE, '', ('arm',), ('position', 'effort'))
        (row,) = encode(layout, np.array([START]), {'effort.arm': np.array([np.nan])})
        with SessionWriter(tmp_path / 'bag') as writer:
            writer.write_blocks(session_blocks(random_session(30)))
            writer.add_topic('/joint_states', JOINT_STATE)
            writer.write('/joint_states', row.tobytes(), START)
        session = read_session(tmp_path / 'bag')
        assert_same(session, random_session(30))
        assert '/joint_states was left out' in session.warnings[0]
        with pytest.raises(StageError, match=r'/joint_states holds .*\(effort.arm at stamp'):
            read_session(tmp_path / 'bag', topics=['/joint_states'])

    def test_wrong_type(self, tmp_path: Path) -> None:
        with SessionWriter(tmp_path / 'bag') as writer:
            writer.add_topic(topics.REFERENCE, 'geometry_msgs/msg/PointStamped')
        with pytest.raises(StageError, match='a session has sensor_msgs/msg/JointState'):
            read_session(tmp_path / 'bag')

    @pytest.mark.parametrize(
        'data', [b'', b'\0\1', b'\0\1\0\0' + bytes(30), b'\0\7\0\0' + bytes(60)]
    )
    def test_malformed_message(self, tmp_path: Path, data: bytes) -> None:
        with SessionWriter(tmp_path / 'bag') as writer:
            writer.write(topics.TRACKER_POINT, data, 5)
        with pytest.raises(StageError, match='/tracker/point is no geometry_msgs'):
            read_session(tmp_path / 'bag')

    def test_unknown_type_cannot_be_written(self, tmp_path: Path) -> None:
        with (
            SessionWriter(tmp_path / 'bag') as writer,
            pytest.raises(StageError, match='type of /other is unknown'),
        ):
            writer.add_topic('/other')
        with (
            SessionWriter(tmp_path / 'bag2') as writer,
            pytest.raises(StageError, match='own_msgs/msg/Odd is unknown'),
        ):
            writer.add_topic('/other', 'own_msgs/msg/Odd')

    def test_missing_file_of_a_bag(self, bag: Path) -> None:
        (bag / 'bag_0.mcap').unlink()
        with pytest.raises(StageError, match='lacks its file bag_0.mcap'):
            read_session(bag)

    def test_missing_file_of_another_storage(self, tmp_path: Path) -> None:
        with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
            kind = 'geometry_msgs/msg/PointStamped'
            writer.add_connection('/tracker/point', kind, typestore=typestore())
        (tmp_path / 'bag' / 'bag.db3').unlink()
        for use in (read_session, info.describe):
            with pytest.raises(StageError, match='bag.db3'):
                use(tmp_path / 'bag')

    @pytest.mark.parametrize('text', ['', '{', 'a: 1', 'rosbag2_bagfile_information: 3', '\0\xff'])
    def test_unreadable_metadata_does_not_matter(self, bag: Path, text: str) -> None:
        (bag / 'metadata.yaml').write_text(text)
        session = read_session(bag)
        assert 'metadata.yaml' in session.warnings[0] and session.twin is not None
        with pytest.raises(StageError, match='session_bags repair'):
            load(bag)

    def test_garbage_messages_never_escape(self, tmp_path: Path) -> None:
        rng = np.random.default_rng(11)
        for number in range(12):
            path = tmp_path / f'bag{number}'
            with SessionWriter(path) as writer:
                for topic, kind in topics.TOPIC_TYPES.items():
                    if kind in NUMERIC_TYPES:
                        size = int(rng.integers(0, 200))
                        noise = b'\0\1\0\0' + rng.integers(0, 4, size, np.uint8).tobytes()
                        writer.write(topic, noise, number)
            with pytest.raises(StageError):
                read_session(path)
