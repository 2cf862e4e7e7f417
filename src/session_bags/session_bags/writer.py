"""Writing a session bag: a rosbag2 directory with one mcap file."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from session_bags import metadata
from session_bags.bulk import Block, merge, session_blocks
from session_bags.container import MESSAGE, MESSAGE_HEADER, ContainerWriter
from session_bags.definitions import definition, quality_of_service
from stage_core import topics
from stage_core.errors import StageError
from stage_core.ownership import hold
from stage_core.session import Session
from stage_core.twin_file import TwinFile

Twin = TwinFile | Mapping[str, Any] | None

TWIN_KEY = 'twin'


class SessionWriter:
    """Writes messages to a new bag; what is older than `chunk_period` is safe from a kill.

    Parameters
    ----------
    path
        Directory of the bag; must not exist.
    twin
        Nominal twin, kept in ``custom_data``.
    chunk_bytes, chunk_period
        A chunk is closed and written at this size [byte] or age [s], whichever comes first.

    Raises
    ------
    StageError
        If the path exists or cannot be created, and from any write on a full disk; the file
        then holds every message up to the last complete chunk.
    """

    def __init__(
        self,
        path: str | Path,
        twin: Twin = None,
        *,
        chunk_bytes: int = 256 * 1024,
        chunk_period: float = 0.5,
    ) -> None:
        self.path = Path(path)
        self._chunk_bytes = chunk_bytes
        self._chunk_period = chunk_period
        file_name = f'{self.path.name}_0.mcap'
        try:
            self.path.mkdir(parents=True)
            self._stream = open(self.path / file_name, 'xb', buffering=0)  # noqa: SIM115
            # `repair` must not replace a file that is still written.
            hold(self._stream)
        except FileExistsError as error:
            raise StageError(
                f'{self.path} exists already: choose another name, a bag is never overwritten'
            ) from error
        except OSError as error:
            raise StageError(
                f'cannot create the bag {self.path} ({error.strerror}): choose a directory that '
                'can be written to'
            ) from error
        self._file = metadata.FileRecord(file_name)
        self._metadata = metadata.BagMetadata(files=[self._file])
        if twin is not None:
            content = twin.to_dict() if isinstance(twin, TwinFile) else dict(twin)
            self._metadata.custom_data[TWIN_KEY] = yaml.safe_dump(content, sort_keys=False)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._records: list[bytes] = []
        self._index: dict[int, list[tuple[int, int]]] = {}
        self._size = 0
        self._opened = 0.0
        self._closed = False
        with self._disk():
            self._container = ContainerWriter(self._stream)
            # A provisional description: an unfinished bag is still known as one.
            self._metadata.save(self.path)

    @property
    def counts(self) -> dict[str, int]:
        """Messages per topic, those in the open chunk included."""
        counts = self._container.counts
        return {
            topic: counts[channel] + len(self._index.get(channel, ()))
            for topic, channel in self._channels.items()
        }

    def add_topic(
        self, topic: str, type_name: str | None = None, latched: bool | None = None
    ) -> int:
        """Announce a topic and return its channel; a session's topics need no type.

        Raises
        ------
        StageError
            For a type that is unknown, or no type for a topic that no session has.
        """
        if topic in self._channels:
            return self._channels[topic]
        type_name = type_name or topics.TOPIC_TYPES.get(topic)
        if type_name is None:
            raise StageError(f'the type of {topic} is unknown: name it when the topic is added')
        text, type_hash = definition(type_name)
        qos = [quality_of_service(topic in topics.LATCHED if latched is None else latched)]
        with self._disk():
            if type_name not in self._schemas:
                schema = Schema(
                    id=len(self._schemas) + 1, name=type_name, encoding='ros2msg',
                    data=text.encode(),
                )  # fmt: skip
                self._container.add_schema(schema)
                self._schemas[type_name] = schema.id
            channel = Channel(
                id=len(self._channels) + 1,
                topic=topic,
                message_encoding='cdr',
                schema_id=self._schemas[type_name],
                metadata={
                    'offered_qos_profiles': metadata.dump(qos).strip(),
                    'topic_type_hash': type_hash,
                },
            )
            self._container.add_channel(channel)
        self._channels[topic] = channel.id
        self._metadata.topics.append(metadata.TopicRecord(topic, type_name, type_hash, qos))
        return channel.id

    def write(
        self,
        topic: str,
        data: bytes,
        log_time: int,
        publish_time: int | None = None,
        sequence: int = 0,
    ) -> None:
        """Append one CDR message; `log_time` is its arrival, `publish_time` its source's [ns]."""
        channel = self._channels.get(topic) or self.add_topic(topic)
        if not self._records:
            self._opened = time.monotonic()
        published = log_time if publish_time is None else publish_time
        record = (
            MESSAGE.pack(
                Opcode.MESSAGE,
                MESSAGE_HEADER + len(data),
                channel,
                sequence & 0xFFFFFFFF,
                log_time,
                published,
            )
            + data
        )
        self._records.append(record)
        self._index.setdefault(channel, []).append((log_time, self._size))
        self._size += len(record)
        if self._size >= self._chunk_bytes:
            self.flush()
        else:
            self.flush_old()

    def flush_old(self) -> None:
        """Write the open chunk if its first message is older than the chunk period."""
        if self._records and time.monotonic() - self._opened >= self._chunk_period:
            self.flush()

    def flush(self) -> None:
        """Write the open chunk."""
        if not self._records:
            return
        data = b''.join(self._records)
        index = {c: np.array(rows, dtype=np.uint64) for c, rows in self._index.items()}
        self._records, self._index, self._size = [], {}, 0
        with self._disk():
            self._container.add_chunk(data, index)

    def write_blocks(self, blocks: Sequence[Block], chunk_bytes: int = 1 << 20) -> None:
        """Append many messages of several topics, merged by time."""
        self.flush()
        if not blocks:
            return
        channels = [self.add_topic(block.topic) for block in blocks]
        for data, index in merge(blocks, channels, chunk_bytes, dict(self._container.counts)):
            with self._disk():
                self._container.add_chunk(data, index)

    def close(self, custom_data: Mapping[str, str] | None = None) -> None:
        """Finish the bag: the last chunk, the index and ``metadata.yaml``; idempotent."""
        if self._closed:
            return
        self.flush()
        self._metadata.custom_data.update(custom_data or {})
        with self._disk():
            self._finish()
        self._closed = True

    def _finish(self) -> None:
        container = self._container
        self._file.start, self._file.end = container.start, container.end
        self._file.count = container.message_count
        for topic in self._metadata.topics:
            topic.count = container.counts[self._channels[topic.name]]
        inner = metadata.dump(self._metadata.content())
        container.add_metadata('rosbag2', {'serialized_metadata': inner})
        container.finish()
        self._stream.close()
        self._metadata.save(self.path)

    @contextlib.contextmanager
    def _disk(self) -> Iterator[None]:
        """Turns a failed write into one clear error, the file being closed in good order."""
        if self._closed:
            raise StageError(f'the bag {self.path} is closed: open a new one to go on recording')
        try:
            yield
        except OSError as error:
            raise self._give_up(error) from error

    def _give_up(self, error: OSError) -> StageError:
        """Leave complete records only, finish the file if that fits, and say what happened."""
        self._closed = True
        self._records, self._index, self._size = [], {}, 0
        if not hasattr(self, '_container'):
            self._stream.close()
            return StageError(f'cannot write the bag {self.path} ({error.strerror}): free space')
        container = self._container
        kept = container.position
        # Closed already where the file fitted and metadata.yaml did not: `repair` writes that.
        with contextlib.suppress(OSError):
            if not self._stream.closed:
                self._stream.truncate(kept)
                self._stream.seek(kept)
                self._finish()
        if not self._stream.closed:
            self._stream.truncate(kept)
            self._stream.close()
        return StageError(
            f'recording to {self.path} stopped ({error.strerror}): free space and start a new '
            f'bag; the {container.message_count} messages so far are kept'
        )

    def __enter__(self) -> SessionWriter:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def write_session(path: str | Path, session: Session, twin: Twin = None) -> Path:
    """Write a session held as arrays; log time = stamp. Returns the bag's directory.

    The twin is the session's own where none is given.
    """
    with SessionWriter(path, twin if twin is not None else session.twin) as writer:
        writer.write_blocks(session_blocks(session))
    return Path(path)
