"""Writing the mcap container: schemas, channels, chunks with their message index, summary."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import replace
from io import RawIOBase

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from numpy.typing import NDArray

MAGIC = b'\x89MCAP0\r\n'
LIBRARY = 'session_bags'
#: Opcode and length of every record, then the fixed fields of a message record.
RECORD_HEADER = 9
MESSAGE_HEADER = 22
#: Both of a message: opcode, length, channel, sequence, log time and publish time [ns].
MESSAGE = struct.Struct('<BQHIQQ')
MESSAGE_RECORD = np.dtype(
    [
        ('opcode', 'u1'),
        ('length', '<u8'),
        ('channel', '<u2'),
        ('sequence', '<u4'),
        ('log_time', '<u8'),
        ('publish_time', '<u8'),
    ]
)

#: Channel -> its messages in a chunk: rows of (log time [ns], offset in the chunk), uint64.
ChunkMessages = Mapping[int, NDArray[np.uint64]]


class ContainerWriter:
    """Writes one mcap file to an unbuffered stream; every call leaves complete records there.

    Schemas and channels stand outside the chunks, so that each complete chunk of an unfinished
    file can be read without the ones before it.
    """

    def __init__(self, stream: RawIOBase) -> None:
        self._stream = stream
        self._compressor = zstandard.ZstdCompressor(level=1)
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.counts: dict[int, int] = {}
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self.start = 0
        self.end = 0
        #: Length of the file up to the last complete record [byte].
        self.position = 0
        self._put(MAGIC + _encode(Header('ros2', LIBRARY)))

    @property
    def message_count(self) -> int:
        """Number of messages in the chunks written so far."""
        return sum(self.counts.values())

    def _put(self, data: bytes) -> None:
        rest = memoryview(data)
        while rest:
            rest = rest[self._stream.write(rest) :]
        self.position += len(data)

    def add_schema(self, schema: Schema) -> None:
        """Write a schema; its id is the caller's."""
        self.schemas[schema.id] = schema
        self._put(_encode(schema))

    def add_channel(self, channel: Channel) -> None:
        """Write a channel; its id is the caller's."""
        self.channels[channel.id] = channel
        self.counts.setdefault(channel.id, 0)
        self._put(_encode(channel))

    def add_metadata(self, name: str, content: dict[str, str]) -> None:
        """Write a metadata record."""
        record = _encode(Metadata(name=name, metadata=content))
        self._metadata.append(MetadataIndex(offset=self.position, length=len(record), name=name))
        self._put(record)

    def add_chunk(self, data: bytes, messages: ChunkMessages) -> None:
        """Compress and write a chunk of message records."""
        chunk = Chunk(
            compression='zstd',
            data=self._compressor.compress(data),
            message_start_time=0,
            message_end_time=0,
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        self.add_compressed_chunk(chunk, messages)

    def add_compressed_chunk(self, record: Chunk, messages: ChunkMessages) -> None:
        """Write a chunk that is compressed already, with its message index and their times."""
        times = [rows[:, 0] for rows in messages.values() if len(rows)]
        if not times:
            return
        start, end = int(min(t.min() for t in times)), int(max(t.max() for t in times))
        chunk = _encode(replace(record, message_start_time=start, message_end_time=end))
        offsets: dict[int, int] = {}
        indexes: list[bytes] = []
        position = self.position + len(chunk)
        for channel, rows in messages.items():
            offsets[channel] = position
            indexes.append(_message_index(channel, rows))
            position += len(indexes[-1])
        index_length = position - self.position - len(chunk)
        entry = ChunkIndex(
            chunk_length=len(chunk),
            chunk_start_offset=self.position,
            compression=record.compression,
            compressed_size=len(record.data),
            message_end_time=end,
            message_index_length=index_length,
            message_index_offsets=offsets,
            message_start_time=start,
            uncompressed_size=record.uncompressed_size,
        )
        self._put(chunk + b''.join(indexes))
        self.start = min(start, self.start) if self._chunks else start
        self.end = max(end, self.end)
        self._chunks.append(entry)
        for channel, rows in messages.items():
            self.counts[channel] = self.counts.get(channel, 0) + len(rows)

    def finish(self) -> None:
        """Write the end of the data, the summary and the footer."""
        data_end = _encode(DataEnd(0))
        summary_start = self.position + len(data_end)
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, list(self.schemas.values())),
            (Opcode.CHANNEL, list(self.channels.values())),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, list(self._chunks)),
            (Opcode.METADATA_INDEX, list(self._metadata)),
        ]
        summary = b''
        offsets = b''
        for opcode, records in groups:
            if not records:
                continue
            encoded = b''.join(_encode(record) for record in records)
            offset = SummaryOffset(
                group_opcode=opcode,
                group_start=summary_start + len(summary),
                group_length=len(encoded),
            )
            summary += encoded
            offsets += _encode(offset)
        footer = _encode(
            Footer(
                summary_start=summary_start,
                summary_offset_start=summary_start + len(summary),
                summary_crc=0,
            )
        )
        # The checksum covers the summary and the footer up to the checksum itself.
        crc = zlib.crc32(summary + offsets + footer[:-4])
        footer = footer[:-4] + crc.to_bytes(4, 'little')
        self._put(data_end + summary + offsets + footer + MAGIC)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self.channels),
            channel_message_counts=dict(self.counts),
            chunk_count=len(self._chunks),
            message_count=self.message_count,
            message_end_time=self.end,
            message_start_time=self.start,
            metadata_count=len(self._metadata),
            schema_count=len(self.schemas),
        )


def _encode(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def _message_index(channel: int, rows: NDArray[np.uint64]) -> bytes:
    body = np.ascontiguousarray(rows, dtype='<u8').tobytes()
    return (
        bytes([Opcode.MESSAGE_INDEX])
        + (6 + len(body)).to_bytes(8, 'little')
        + channel.to_bytes(2, 'little')
        + len(body).to_bytes(4, 'little')
        + body
    )
