"""Reading a session bag into arrays."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from session_bags.bag import Bag, open_bag
from session_bags.cdr import NUMERIC_TYPES
from session_bags.columns import TopicDecoder
from session_bags.decoding import Decoders, read_foreign, read_places
from session_bags.messages import raw_messages
from session_bags.window import read_window, window_stamps
from session_bags.writer import TWIN_KEY
from stage_core import topics as names
from stage_core.errors import StageError
from stage_core.frames import RigidTransform, alignment
from stage_core.session import Series, Session
from stage_core.untrusted import yaml_mapping


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
        Hand over messages with NaN or infinity; otherwise they are an error, or a warning of a
        topic that no session has and nobody named.

    Raises
    ------
    StageError
        If there is no such bag, it holds no message, it is damaged, a topic of a session has
        another type, a message is malformed or holds a NaN.
    """
    bag = open_bag(path)
    types = bag.topic_types()
    wanted = _numeric(types, topics, path)
    if names.ALIGNMENT in types and topics is not None and names.TRACKER_POINT in topics:
        wanted.append(names.ALIGNMENT)
    decoders = {topic: TopicDecoder(topic, types[topic], str(path)) for topic in wanted}
    whole = start is None and stop is None
    window = None if whole else window_stamps(bag, types, start, stop)
    if window is None or bag.description.foreign:
        decode(bag, decoders)
    else:
        read_window(bag, decoders, *window)
    warnings = list(bag.warnings)
    series = {}
    aligned = None
    for topic, decoder in decoders.items():
        if not allow_nan and (bad := decoder.not_a_number()):
            warnings.append(_left_out(path, topic, bad, topics is not None))
            continue
        if decoder.unsorted():
            warnings.append(f'{topic} is not in the order of its stamps; it was sorted')
        if topic == names.ALIGNMENT:
            aligned = last_alignment(decoder.last_frame(), decoder.series().get(topic))
            continue
        for key, part in decoder.series().items():
            series[key] = part if window is None else part.between(*window)
    if not any(decoder.count for decoder in decoders.values()) and topics is None:
        raise StageError(f'{path} holds no message of a session: record it again')
    return Session(
        str(path), series, _twin(bag, warnings), aligned, tuple(warnings), _recorded(bag)
    )


def _left_out(path: str | Path, topic: str, bad: str, named: bool) -> str:
    """The warning about a topic that holds no number somewhere; an error where it is needed."""
    if named or topic in names.TOPIC_TYPES:
        raise StageError(
            f'{path}: {topic} holds a value that is not a finite number ({bad}): mend its source '
            'and record the session again'
        )
    return f'{topic} was left out: it holds a value that is not finite ({bad})'


def _recorded(bag: Bag) -> int:
    """Wall time of the first message [ns]; zero where the bag holds none.

    In simulated time, which begins in 1970, it is that of the message's publication.
    """
    first = next(raw_messages(bag), None)
    return 0 if first is None else max(first.log_time, first.publish_time)


def _numeric(
    types: Mapping[str, str], topics: Collection[str] | None, path: str | Path
) -> list[str]:
    """Numeric topics among those asked for; one of a session must have the session's type."""
    for topic, type_name in types.items():
        expected = names.TOPIC_TYPES.get(topic)
        if expected in NUMERIC_TYPES and type_name != expected:
            raise StageError(
                f'{path}: {topic} is of type {type_name} where a session has {expected}: '
                'record it with the right type'
            )
    return [
        topic
        for topic, type_name in types.items()
        if type_name in NUMERIC_TYPES and (topics is None or topic in topics)
    ]


def decode(bag: Bag, decoders: Decoders) -> None:
    """Feed every message of the decoders' topics to them.

    Raises
    ------
    StageError
        If the bag is damaged or a message is malformed.
    """
    if bag.description.foreign:
        read_foreign(bag, decoders)
    else:
        read_places(bag, decoders, lambda index, place: True)


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


def last_alignment(frame: str, series: Series | None) -> RigidTransform | None:
    """The last alignment of a series, whose message has this frame."""
    if series is None or not len(series):
        return None
    last = {name: column[-1] for name, column in series.values.items()}
    return alignment(
        frame,
        [last[f'rotation.{axis}'] for axis in 'xyzw'],
        [last[f'translation.{axis}'] for axis in 'xyz'],
    )
