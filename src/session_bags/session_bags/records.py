"""Finding the chunks of an mcap file, finished or not, and the messages inside them."""

from __future__ import annotations

import contextlib
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Footer, Metadata, Schema, Statistics
from numpy.typing import NDArray

from session_bags.container import MAGIC, MESSAGE, MESSAGE_RECORD, RECORD_HEADER
from stage_core.errors import StageError

_FOOTER_SIZE = RECORD_HEADER + 20 + len(MAGIC)
_RECORD = struct.Struct('<BQ')
#: No recorder makes a chunk larger than this; a damaged file may claim it [byte].
_MAX_CHUNK = 1 << 30


@dataclass
class ChunkPlace:
    """Where a chunk lies in its file.

    Attributes
    ----------
    offset, length : int
        Place of the chunk record [byte]; of a run of bare message records where `bare`.
    start, end : int
        Times of arrival of its messages [ns]; of a bare run unknown and zero.
    index : dict
        Channel -> offset of its message index in the file; empty where there is none.
    index_end : int
        End of the message indexes in the file [byte].
    """

    offset: int
    length: int
    start: int = 0
    end: int = 0
    index: dict[int, int] = field(default_factory=dict)
    index_end: int = 0
    bare: bool = False


@dataclass
class FileIndex:
    """What an mcap file holds and where."""

    path: Path
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkPlace] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    finished: bool = True
    #: Whether the file ends before its data do; one that is not finished may lack its index only.
    cut: bool = False
    #: From the statistics; unknown in an unfinished file.
    start: int = 0
    end: int = 0
    counts: dict[int, int] = field(default_factory=dict)
    #: Bytes after the last complete record of an unfinished file.
    lost_bytes: int = 0

    @property
    def message_count(self) -> int:
        """Messages by the statistics."""
        return sum(self.counts.values())


def read_index(path: Path) -> FileIndex:
    """Index of a file from its summary, or by scanning it where the summary is missing.

    Raises
    ------
    StageError
        If the file cannot be read, is no mcap file or is damaged.
    """
    try:
        with open(path, 'rb') as stream:
            head = stream.read(len(MAGIC))
            if not head:
                # Its recorder was killed before it wrote a byte.
                return FileIndex(path, finished=False, cut=True)
            if head != MAGIC:
                raise StageError(f'{path} is not an mcap file: name a session bag')
            index = _from_summary(path, stream)
            return index if index is not None else _from_scan(path, stream)
    except OSError as error:
        raise StageError(
            f'cannot read {path} ({error.strerror}): check its name and permissions'
        ) from error
    except (struct.error, McapError, ValueError, IndexError) as error:
        raise _damaged(path) from error


def _records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Opcode and body of each complete record in `data`."""
    position = 0
    while position + RECORD_HEADER <= len(data):
        opcode, length = _RECORD.unpack_from(data, position)
        position += RECORD_HEADER
        if position + length > len(data):
            return
        yield opcode, data[position : position + length]
        position += length


def _stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(body))


def _from_summary(path: Path, stream: BinaryIO) -> FileIndex | None:
    """Index from the summary section; None where the file has none that can be trusted."""
    size = stream.seek(0, 2)
    if size < _FOOTER_SIZE + len(MAGIC):
        return None
    stream.seek(size - _FOOTER_SIZE)
    tail = stream.read()
    if tail[-len(MAGIC) :] != MAGIC or tail[0] != Opcode.FOOTER:
        return None
    footer = Footer.read(_stream(tail[RECORD_HEADER:]))
    if not 0 < footer.summary_start <= size - _FOOTER_SIZE:
        return None
    stream.seek(footer.summary_start)
    summary = stream.read(size - _FOOTER_SIZE - footer.summary_start)
    checked = summary + tail[: RECORD_HEADER + 16]
    if footer.summary_crc and zlib.crc32(checked) != footer.summary_crc:
        return None
    index = FileIndex(path)
    messages: int | None = None
    for opcode, body in _records(summary):
        if opcode == Opcode.STATISTICS:
            statistics = Statistics.read(_stream(body))
            messages = statistics.message_count
            index.counts = dict(statistics.channel_message_counts)
            index.start = statistics.message_start_time
            index.end = statistics.message_end_time
        elif opcode == Opcode.CHUNK_INDEX:
            entry = ChunkIndex.read(_stream(body))
            place = ChunkPlace(
                entry.chunk_start_offset,
                entry.chunk_length,
                entry.message_start_time,
                entry.message_end_time,
                entry.message_index_offsets,
                entry.chunk_start_offset + entry.chunk_length + entry.message_index_length,
            )
            if place.index_end > size:
                return None
            index.chunks.append(place)
        else:
            _note(index, opcode, body)
    described = all(c.schema_id in {0, *index.schemas} for c in index.channels.values())
    if messages is None or not described or messages and not (index.chunks and index.channels):
        # A file without chunks, or one that does not repeat its channels, schemas or numbers.
        return None
    _metadata_before(index, stream, footer.summary_start)
    return index


def _metadata_before(index: FileIndex, stream: BinaryIO, summary_start: int) -> None:
    """Read the metadata records between the last chunk and the summary."""
    begin = max((place.index_end for place in index.chunks), default=len(MAGIC))
    stream.seek(begin)
    for opcode, body in _records(stream.read(summary_start - begin)):
        if opcode == Opcode.METADATA:
            _note(index, opcode, body)


def _note(index: FileIndex, opcode: int, body: bytes) -> None:
    """Keep a schema, channel or metadata record."""
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(_stream(body))
        index.schemas[schema.id] = schema
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(_stream(body))
        index.channels[channel.id] = channel
    elif opcode == Opcode.METADATA:
        record = Metadata.read(_stream(body))
        index.metadata[record.name] = record.metadata


def _from_scan(path: Path, stream: BinaryIO) -> FileIndex:
    """Index by walking the file up to its last complete record, behind its last whole chunk."""
    index = FileIndex(path, finished=False, cut=True)
    size = stream.seek(0, 2)
    position, whole = len(MAGIC), 0
    while position + RECORD_HEADER <= size:
        stream.seek(position)
        opcode, length = _RECORD.unpack(stream.read(RECORD_HEADER))
        end = position + RECORD_HEADER + length
        if end > size or not 0 < opcode <= 0x0F:
            break
        if opcode == Opcode.DATA_END:
            # The data are complete; at most the summary is missing.
            index.cut = False
            return index
        if opcode == Opcode.CHUNK:
            stream.seek(position)
            place = ChunkPlace(position, end - position, index_end=end)
            index.chunks.append(place)
            with contextlib.suppress(StageError):
                chunk = split_chunk(stream.read(end - position), path)
                place.start, place.end = chunk.message_start_time, chunk.message_end_time
                for inner_opcode, body in _records(unpack_chunk(chunk, path)):
                    if inner_opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                        _note(index, inner_opcode, body)
                whole = len(index.chunks)
        elif opcode == Opcode.MESSAGE_INDEX and index.chunks:
            channel = int.from_bytes(stream.read(2), 'little')
            index.chunks[-1].index[channel] = position
            index.chunks[-1].index_end = end
        elif opcode == Opcode.MESSAGE:
            last = index.chunks[-1] if index.chunks else None
            if last is not None and last.bare and last.offset + last.length == position:
                index.chunks[-1] = ChunkPlace(last.offset, end - last.offset, bare=True)
            else:
                index.chunks.append(ChunkPlace(position, end - position, bare=True))
            whole = len(index.chunks)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA):
            _note(index, opcode, stream.read(length))
        position = end
    if len(index.chunks) > whole:
        # The last pages of a killed machine; a damaged chunk before a whole one is for `repair`.
        position = index.chunks[whole].offset
        del index.chunks[whole:]
    index.lost_bytes = size - position
    if index.chunks:
        # The end may have cut its message indexes: its messages are found by walking.
        index.chunks[-1].index = {}
    return index


def split_chunk(raw: bytes, path: Path) -> Chunk:
    """The parts of a chunk record, which may stand before others."""
    try:
        chunk = Chunk.read(_stream(raw[RECORD_HEADER:]))
    except (struct.error, McapError, ValueError, OverflowError) as error:
        raise _damaged(path) from error
    if raw[0] != Opcode.CHUNK or chunk.uncompressed_size > _MAX_CHUNK:
        raise _damaged(path)
    return chunk


def unpack_chunk(chunk: Chunk, path: Path) -> bytes:
    """Uncompressed records of a chunk, checked against its checksum."""
    data, compression, size = chunk.data, chunk.compression, chunk.uncompressed_size
    try:
        if compression == 'zstd':
            data = zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
        elif compression == 'lz4':
            data = lz4.frame.decompress(data)
        elif compression:
            raise StageError(
                f'{path} is compressed with {compression}: rewrite it with zstd or lz4'
            )
    except (zstandard.ZstdError, RuntimeError, MemoryError) as error:
        raise _damaged(path) from error
    crc = chunk.uncompressed_crc
    if len(data) != size or (crc and zlib.crc32(data) != crc):
        raise _damaged(path)
    return data


def _damaged(path: Path) -> StageError:
    return StageError(
        f'{path} is damaged (a chunk does not match its checksum): run `ros2 run session_bags '
        'repair` on the bag to keep what is whole'
    )


def walk_messages(data: bytes) -> dict[int, NDArray[np.uint64]]:
    """Channel -> rows of (log time, offset) of the message records in a chunk's bytes."""
    found: dict[int, list[tuple[int, int]]] = {}
    position, unpack = 0, struct.Struct('<BQHIQ').unpack_from
    last = len(data) - MESSAGE.size
    while position <= last:
        opcode, length, channel, _, log_time = unpack(data, position)
        if opcode == Opcode.MESSAGE:
            found.setdefault(channel, []).append((log_time, position))
        position += RECORD_HEADER + length
    return {channel: np.array(rows, np.uint64) for channel, rows in found.items()}


def heads(data: bytes | NDArray[np.uint8], offsets: NDArray[Any]) -> NDArray[np.void]:
    """Fixed parts (n,) of the message records at `offsets` (n,), of type `MESSAGE_RECORD`."""
    size = MESSAGE_RECORD.itemsize
    windows = np.ndarray((len(data) - size + 1,), f'V{size}', data, 0, (1,))
    return windows[offsets.astype(np.int64)].view(MESSAGE_RECORD)


def chunk_messages(
    stream: BinaryIO, path: Path, place: ChunkPlace
) -> tuple[bytes, dict[int, NDArray[np.uint64]]]:
    """Uncompressed records of a chunk, and channel -> rows of (log time, offset) in them.

    Raises
    ------
    StageError
        If the chunk is damaged.
    """
    stream.seek(place.offset)
    raw = stream.read(max(place.length, place.index_end - place.offset))
    data = raw if place.bare else unpack_chunk(split_chunk(raw, path), path)
    found = _indexed_messages(raw, place)
    last = len(data) - MESSAGE.size
    if found is None or any(len(r) and int(r[:, 1].max()) > last for r in found.values()):
        found = walk_messages(data)
    return data, found


def index_agrees(raw: bytes, place: ChunkPlace, messages: dict[int, NDArray[np.uint64]]) -> bool:
    """Whether the message indexes after a chunk name exactly these messages."""
    found = _indexed_messages(raw, place)
    return (
        found is not None
        and found.keys() == messages.keys()
        and all(
            np.array_equal(np.sort(found[c], axis=0), np.sort(messages[c], axis=0)) for c in found
        )
    )


def _indexed_messages(raw: bytes, place: ChunkPlace) -> dict[int, NDArray[np.uint64]] | None:
    """Like :func:`walk_messages` from the message indexes; `raw` is the file from the chunk on.

    None where an index is missing or cut.
    """
    found: dict[int, NDArray[np.uint64]] = {}
    for channel, offset in place.index.items():
        begin = offset - place.offset + RECORD_HEADER + 2
        length = int.from_bytes(raw[begin : begin + 4], 'little')
        body = raw[begin + 4 : begin + 4 + length]
        if len(body) != length or length % 16:
            return None
        found[channel] = np.frombuffer(body, '<u8').reshape(-1, 2)
    return found or None
