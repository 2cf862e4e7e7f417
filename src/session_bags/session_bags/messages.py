"""Messages of a bag as bytes, in order of arrival."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator
from dataclasses import dataclass

from session_bags.bag import Bag
from session_bags.container import MESSAGE, RECORD_HEADER
from session_bags.records import FileIndex, chunk_messages
from stage_core.errors import StageError


@dataclass(frozen=True)
class RawMessage:
    """One message: CDR bytes, arrival and publication [ns]."""

    topic: str
    type_name: str
    log_time: int
    publish_time: int
    sequence: int
    data: bytes


def raw_messages(bag: Bag, topics: Collection[str] | None = None) -> Iterator[RawMessage]:
    """Messages of the named topics, or of all, in order of arrival.

    Raises
    ------
    StageError
        If the bag is damaged.
    """
    if bag.description.foreign:
        yield from _foreign(bag, topics)
        return
    streams = [_of_file(index, topics) for index in bag.files]
    yield from heapq.merge(*streams, key=lambda message: message.log_time)


def _of_file(index: FileIndex, topics: Collection[str] | None) -> Iterator[RawMessage]:
    channels = {
        number: (channel.topic, schema.name)
        for number, channel in index.channels.items()
        if (schema := index.schemas.get(channel.schema_id)) is not None
        and (topics is None or channel.topic in topics)
    }
    # Chunks of different publishers may overlap in time: a message waits until no later chunk
    # can hold an earlier one.
    waiting: list[tuple[int, int, RawMessage]] = []
    number = 0
    places = sorted(index.chunks, key=lambda place: place.start)
    with open(index.path, 'rb') as stream:
        for position, place in enumerate(places):
            data, found = chunk_messages(stream, index.path, place)
            for channel, rows in found.items():
                if channel not in channels:
                    continue
                topic, type_name = channels[channel]
                for offset in rows[:, 1].tolist():
                    _, length, _, sequence, log_time, publish_time = MESSAGE.unpack_from(
                        data, offset
                    )
                    begin, end = offset + MESSAGE.size, offset + RECORD_HEADER + length
                    message = RawMessage(
                        topic, type_name, log_time, publish_time, sequence, data[begin:end]
                    )
                    heapq.heappush(waiting, (log_time, number, message))
                    number += 1
            later = places[position + 1].start if position + 1 < len(places) else None
            while waiting and (later is None or waiting[0][0] <= later):
                yield heapq.heappop(waiting)[2]


def _foreign(bag: Bag, topics: Collection[str] | None) -> Iterator[RawMessage]:
    from rosbags.rosbag2 import Reader

    try:
        with Reader(bag.path) as reader:
            chosen = [c for c in reader.connections if topics is None or c.topic in topics]
            for connection, time, data in reader.messages(chosen) if chosen else ():
                name = connection.msgtype
                yield RawMessage(connection.topic, name, time, time, 0, bytes(data))
    except Exception as error:
        # rosbags raises whatever its storage plugin does; all of it means a bad bag.
        raise StageError(f'cannot read {bag.path} ({error}): the bag is damaged') from error
