"""Messages of a bag handed to the decoders of their topics, many at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from session_bags.bag import Bag
from session_bags.columns import TopicDecoder
from session_bags.container import MESSAGE, MESSAGE_HEADER
from session_bags.messages import raw_messages
from session_bags.records import ChunkPlace, FileIndex, chunk_messages, heads
from stage_core.errors import StageError

#: Uncompressed bytes that are decoded together: large enough to hide the cost of a call.
_BATCH_BYTES = 4 << 20
#: Messages of one topic that rosbags hands over before they are decoded.
_FOREIGN_BATCH = 20_000

Decoders = Mapping[str, TopicDecoder]


def read_places(bag: Bag, decoders: Decoders, wanted: Any) -> None:
    """Decode the chunks for which ``wanted(index, place)`` holds."""
    for index in bag.files:
        channels = {
            number: decoders[channel.topic]
            for number, channel in index.channels.items()
            if channel.topic in decoders
        }
        places = [
            place
            for place in index.chunks
            if (not place.index or not channels.keys().isdisjoint(place.index))
            and wanted(index, place)
        ]
        if channels and places:
            read_file(index, places, channels)


def read_file(
    index: FileIndex, places: Sequence[ChunkPlace], channels: Mapping[int, TopicDecoder]
) -> None:
    """Decode some chunks of a file; the decoders are named by the number of their channel."""
    batch: list[bytes] = []
    offsets: dict[int, list[NDArray[np.uint64]]] = {}
    size = 0
    try:
        with open(index.path, 'rb') as stream:
            for place in places:
                data, found = chunk_messages(stream, index.path, place)
                for channel, rows in found.items():
                    if channel in channels:
                        offsets.setdefault(channel, []).append(rows[:, 1] + np.uint64(size))
                batch.append(data)
                size += len(data)
                if size >= _BATCH_BYTES:
                    _decode(index, batch, offsets, channels)
                    batch, offsets, size = [], {}, 0
    except OSError as error:
        raise StageError(f'cannot read {index.path} ({error.strerror}): check the disk') from error
    _decode(index, batch, offsets, channels)


def _decode(
    index: FileIndex,
    batch: Sequence[bytes],
    offsets: Mapping[int, Sequence[NDArray[np.uint64]]],
    channels: Mapping[int, TopicDecoder],
) -> None:
    """Hand the messages of a batch of chunks to the decoders."""
    data = np.frombuffer(b''.join(batch), np.uint8)
    header = MESSAGE.size
    for channel, blocks in offsets.items():
        places = np.concatenate(blocks).astype(np.int64)
        whole = len(data) >= header and places.min() >= 0 and places.max() <= len(data) - header
        if whole:
            found = heads(data, places)
            sizes = found['length'].astype(np.int64) - MESSAGE_HEADER
            begins = places + header
            whole = bool(
                (found['channel'] == channel).all()
                and (sizes >= 0).all()
                and (begins + sizes <= len(data)).all()
            )
        if not whole:
            raise StageError(
                f'{index.path} is damaged (its message index does not fit its chunks): run '
                '`ros2 run session_bags repair` on the bag'
            )
        channels[channel].feed(data, begins, sizes)


def read_foreign(bag: Bag, decoders: Decoders) -> None:
    """Decode a storage other than mcap, which gives its messages one by one."""
    raw: dict[str, list[bytes]] = {topic: [] for topic in decoders}

    def decode(topic: str) -> None:
        messages, raw[topic] = raw[topic], []
        sizes = np.array([len(m) for m in messages], np.int64)
        if len(sizes):
            data = np.frombuffer(b''.join(messages), np.uint8)
            decoders[topic].feed(data, np.cumsum(sizes) - sizes, sizes)

    for message in raw_messages(bag, decoders.keys()):
        raw[message.topic].append(message.data)
        if len(raw[message.topic]) >= _FOREIGN_BATCH:
            decode(message.topic)
    for topic in raw:
        decode(topic)
