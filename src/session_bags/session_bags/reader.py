"""Reading a session bag into arrays."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from session_bags.bag import Bag, open_bag
from session_bags.bulk import MESSAGE_RECORD
from session_bags.cdr import NUMERIC_TYPES
from session_bags.columns import TopicDecoder
from session_bags.container import MESSAGE_HEADER
from session_bags.records import ChunkPlace, FileIndex, chunk_messages
from session_bags.writer import TWIN_KEY
from stage_core import topics as names
from stage_core.clocks import NANOSECONDS
from stage_core.errors import StageError
from stage_core.frames import RigidTransform
from stage_core.session import Session
from stage_core.untrusted import yaml_mapping

#: Uncompressed bytes that are decoded together: large enough to hide the cost of a call.
_BATCH_BYTES = 4 << 20
#: Messages of one topic that rosbags hands over before they are decoded.
_FOREIGN_BATCH = 20_000

Decoders = Mapping[str, TopicDecoder]


def read_session(
    path: str | Path,
    topics: Collection[str] | None = None,
    start: float | None = None,
    stop: float | None = None,
    *,
    allow_nan: bool = False,
) -> Session:
    """Read the numeric topics of a bag.

    Parameters
    ----------
    path
        Directory of a bag (mcap or sqlite3, finished or not) or a bare mcap file.
    topics
        Topics to read; all numeric ones where none are named.
    start, stop
        Part of the session to read, start <= t < stop, in seconds since its first reference;
        only the chunks that hold it are read. The part is a session of its own.
    allow_nan
        Hand over messages with NaN or infinity; otherwise they are an error.

    Raises
    ------
    StageError
        If there is no such bag, it holds no message, it is damaged, a topic of a session has
        another type, a message is malformed or holds a NaN.
    """
    bag = open_bag(path)
    types = bag.topic_types()
    wanted = _wanted(types, topics, path)
    decoders = {topic: TopicDecoder(topic, types[topic], str(path)) for topic in wanted}
    window = None
    if start is not None or stop is not None:
        window = _window(bag, types, start, stop)
    if window is None or bag.foreign:
        decode(bag, decoders)
    else:
        _read_window(bag, decoders, *window)
    warnings = list(bag.warnings)
    series = {}
    alignment = None
    for topic, decoder in decoders.items():
        bad = None if allow_nan else decoder.not_a_number()
        if bad:
            raise StageError(
                f'{path}: {topic} holds a value that is not a finite number ({bad}): mend its '
                'source and record the session again'
            )
        if decoder.unsorted():
            warnings.append(f'{topic} is not in the order of its stamps; it was sorted')
        if topic == names.ALIGNMENT:
            alignment = _alignment(decoder)
            continue
        for key, part in decoder.series().items():
            series[key] = part if window is None else part.between(*window)
    if not any(decoder.count for decoder in decoders.values()) and topics is None:
        raise StageError(f'{path} holds no message of a session: record it again')
    return Session(str(path), series, _twin(bag, warnings), alignment, tuple(warnings))


def _wanted(
    types: Mapping[str, str], topics: Collection[str] | None, path: str | Path
) -> list[str]:
    """Topics to read; with the tracker's points the alignment that belongs to them."""
    for topic, type_name in types.items():
        expected = names.TOPIC_TYPES.get(topic)
        if expected in NUMERIC_TYPES and type_name != expected:
            raise StageError(
                f'{path}: {topic} is of type {type_name} where a session has {expected}: '
                'record it with the right type'
            )
    chosen = [
        topic
        for topic, type_name in types.items()
        if type_name in NUMERIC_TYPES and (topics is None or topic in topics)
    ]
    if names.ALIGNMENT in types and topics is not None and names.TRACKER_POINT in topics:
        chosen.append(names.ALIGNMENT)
    return list(dict.fromkeys(chosen))


def decode(bag: Bag, decoders: Decoders) -> None:
    """Feed every message of the decoders' topics to them.

    Raises
    ------
    StageError
        If the bag is damaged or a message is malformed.
    """
    if bag.foreign:
        _read_foreign(bag, decoders)
    else:
        _read_places(bag, decoders, lambda index, place: True)


def _twin(bag: Bag, warnings: list[str]) -> dict[str, Any] | None:
    """The nominal twin that the bag carries."""
    text = bag.description.custom_data.get(TWIN_KEY)
    if not text:
        return None
    try:
        return yaml_mapping(text, 'custom_data.twin', 'it was ignored')
    except StageError as error:
        warnings.append(str(error))
        return None


def _alignment(decoder: TopicDecoder) -> RigidTransform | None:
    """The last alignment, as the transform from the tracker to the stage.

    A transform holds the coordinates of the child frame's points in the parent frame, so one
    whose parent is the tracker is inverted.
    """
    frames = decoder.frames()
    series = decoder.series().get(names.ALIGNMENT)
    if series is None or not len(series):
        return None
    last = {name: column[-1] for name, column in series.values.items()}
    transform = RigidTransform.from_quaternion(
        [last[f'rotation.{axis}'] for axis in 'xyzw'],
        [last[f'translation.{axis}'] for axis in 'xyz'],
    )
    inverted = frames[-1] == (names.TRACKER_FRAME, names.STAGE_FRAME)
    return transform.inverse() if inverted else transform


def _read_places(bag: Bag, decoders: Decoders, wanted: Any) -> None:
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
            _read_file(index, places, channels)


def _read_file(
    index: FileIndex, places: Sequence[ChunkPlace], channels: Mapping[int, TopicDecoder]
) -> None:
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
    header = MESSAGE_RECORD.itemsize
    for channel, blocks in offsets.items():
        places = np.concatenate(blocks).astype(np.int64)
        whole = len(data) >= header and places.min() >= 0 and places.max() <= len(data) - header
        if whole:
            windows = np.ndarray((len(data) - header + 1,), f'V{header}', data, 0, (1,))
            heads = windows[places].view(MESSAGE_RECORD)
            sizes = heads['length'].astype(np.int64) - MESSAGE_HEADER
            begins = places + header
            whole = bool(
                (heads['channel'] == channel).all()
                and (sizes >= 0).all()
                and (begins + sizes <= len(data)).all()
            )
        if not whole:
            raise StageError(
                f'{index.path} is damaged (its message index does not fit its chunks): run '
                '`ros2 run session_bags repair` on the bag'
            )
        channels[channel].feed(data, begins, sizes)


def _window(
    bag: Bag, types: Mapping[str, str], start: float | None, stop: float | None
) -> tuple[int, int]:
    """Part of the session as stamps [ns]."""
    if start is not None and stop is not None and not start < stop:
        raise StageError(f'the part from {start} s to {stop} s is empty: name a later end')
    origin = names.REFERENCE if names.REFERENCE in types else None
    numeric = [topic for topic, kind in types.items() if kind in NUMERIC_TYPES]
    if origin is None and not numeric:
        raise StageError(f'{bag.path} holds no message of a session: record it again')
    first = _first_stamp(bag, types, [origin] if origin else numeric)
    begin = first + round((start or 0.0) * NANOSECONDS) if start is not None else -(1 << 62)
    end = first + round(stop * NANOSECONDS) if stop is not None else 1 << 62
    return begin, end


def _first_stamp(bag: Bag, types: Mapping[str, str], wanted: Sequence[str]) -> int:
    """First stamp of the session, from the first chunk with messages of the wanted topics."""
    if bag.foreign:
        decoders = {t: TopicDecoder(t, types[t], str(bag.path)) for t in wanted}
        _read_foreign(bag, decoders)
        return _earliest(bag, decoders)
    for index in bag.files:
        numbers = {n for n, channel in index.channels.items() if channel.topic in wanted}
        for place in sorted(index.chunks, key=lambda p: p.start):
            if place.index and numbers.isdisjoint(place.index):
                continue
            decoders = {t: TopicDecoder(t, types[t], str(bag.path)) for t in wanted}
            channels = {n: decoders[index.channels[n].topic] for n in numbers}
            _read_file(index, [place], channels)
            if any(decoder.count for decoder in decoders.values()):
                return _earliest(bag, decoders)
    return _earliest(bag, {})


def _earliest(bag: Bag, decoders: Decoders) -> int:
    series = [part for decoder in decoders.values() for part in decoder.series().values()]
    if not series:
        raise StageError(f'{bag.path} holds no message of a session: record it again')
    return min(int(part.stamps[0]) for part in series)


def _read_window(bag: Bag, decoders: dict[str, TopicDecoder], begin: int, end: int) -> None:
    """Read the chunks that hold the stamps begin <= stamp < end, and every alignment.

    Chunks are indexed by time of arrival, which differs from the stamps by an unknown lag and,
    for a session recorded faster than real time, in rate. Both are bounded by reading on until
    the chunks on either side hold only earlier or later stamps.
    """
    places = [(i, p) for i in bag.files for p in i.chunks]
    places.sort(key=lambda item: item[1].start)
    spans: dict[int, tuple[int, int] | None] = {}

    def span(number: int) -> tuple[int, int] | None:
        """Earliest and latest stamp in a chunk; None where it holds none of the topics."""
        if number not in spans:
            index, place = places[number]
            trial = {t: TopicDecoder(t, d.type_name, str(bag.path)) for t, d in decoders.items()}
            chosen = {
                n: trial[c.topic]
                for n, c in index.channels.items()
                if c.topic in trial and c.topic != names.ALIGNMENT
            }
            if chosen and (not place.index or not chosen.keys().isdisjoint(place.index)):
                _read_file(index, [place], chosen)
            found = [s for d in trial.values() for s in d.series().values()]
            spans[number] = (
                (min(int(s.stamps[0]) for s in found), max(int(s.stamps[-1]) for s in found))
                if found
                else None
            )
        return spans[number]

    def first_not_before(stamp: int) -> int:
        """First chunk whose latest stamp is not before `stamp`, by bisection."""
        low, high = 0, len(places)
        while low < high:
            middle = probe = (low + high) // 2
            while probe < high and span(probe) is None:
                probe += 1
            if probe == high:
                high = middle
            elif span(probe)[1] < stamp:  # type: ignore[index]
                low = probe + 1
            else:
                high = middle
        return low

    # Neighbouring chunks overlap where messages of one moment arrive across a boundary.
    lower = max(first_not_before(begin) - 1, 0)
    upper = min(first_not_before(end) + 2, len(places))
    inside = {(id(i), p.offset) for i, p in places[lower:upper]}
    main = {t: d for t, d in decoders.items() if t != names.ALIGNMENT}
    _read_places(bag, main, lambda index, place: (id(index), place.offset) in inside)
    if names.ALIGNMENT in decoders:
        latched = {names.ALIGNMENT: decoders[names.ALIGNMENT]}
        _read_places(bag, latched, lambda index, place: True)


def _read_foreign(bag: Bag, decoders: Decoders) -> None:
    """Read a storage other than mcap through rosbags."""
    from rosbags.rosbag2 import Reader

    raw: dict[str, list[bytes]] = {topic: [] for topic in decoders}

    def decode(topic: str) -> None:
        messages, raw[topic] = raw[topic], []
        sizes = np.array([len(m) for m in messages], np.int64)
        if len(sizes):
            data = np.frombuffer(b''.join(messages), np.uint8)
            decoders[topic].feed(data, np.cumsum(sizes) - sizes, sizes)

    try:
        with Reader(bag.path) as reader:
            connections = [c for c in reader.connections if c.topic in decoders]
            for connection, _, data in reader.messages(connections) if connections else ():
                raw[connection.topic].append(bytes(data))
                if len(raw[connection.topic]) >= _FOREIGN_BATCH:
                    decode(connection.topic)
    except StageError:
        raise
    except Exception as error:
        # rosbags raises whatever its storage plugin does; all of it means a bad bag.
        raise StageError(f'cannot read {bag.path} ({error}): the bag is damaged') from error
    for topic in raw:
        decode(topic)
