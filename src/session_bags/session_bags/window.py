"""A part of a session: the chunks of a bag that hold it."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from functools import cache

from session_bags.bag import Bag
from session_bags.cdr import NUMERIC_TYPES
from session_bags.columns import TopicDecoder
from session_bags.decoding import Decoders, read_file, read_foreign, read_places
from stage_core import topics as names
from stage_core.clocks import NANOSECONDS
from stage_core.errors import StageError

#: A stamp after all others [ns].
_NEVER = 1 << 62


def window_stamps(
    bag: Bag, types: Mapping[str, str], start: float | None, stop: float | None
) -> tuple[int, int]:
    """Part of the session as stamps [ns]."""
    if start is not None and stop is not None and not start < stop:
        raise StageError(f'the part from {start} s to {stop} s is empty: name a later end')
    numeric = types.keys() - {names.ALIGNMENT}
    wanted = [t for t in numeric if types[t] in NUMERIC_TYPES]
    first = _first_stamp(bag, types, [names.REFERENCE] if names.REFERENCE in types else wanted)
    begin = first + round((start or 0.0) * NANOSECONDS) if start is not None else -_NEVER
    end = first + round(stop * NANOSECONDS) if stop is not None else _NEVER
    return begin, end


def _first_stamp(bag: Bag, types: Mapping[str, str], wanted: Sequence[str]) -> int:
    """First stamp of the session, from the first chunk with messages of each wanted topic."""
    decoders = {t: TopicDecoder(t, types[t], str(bag.path)) for t in wanted}
    if bag.description.foreign:
        read_foreign(bag, decoders)
        return _earliest(bag, decoders)
    for index in bag.files:
        for place in sorted(index.chunks, key=lambda p: p.start):
            channels = {
                number: decoders[channel.topic]
                for number, channel in index.channels.items()
                if channel.topic in decoders and not decoders[channel.topic].count
            }
            if channels and not (place.index and channels.keys().isdisjoint(place.index)):
                read_file(index, [place], channels)
    return _earliest(bag, decoders)


def _earliest(bag: Bag, decoders: Decoders) -> int:
    series = [part for decoder in decoders.values() for part in decoder.series().values()]
    if not series:
        raise StageError(f'{bag.path} holds no message of a session: record it again')
    return min(int(part.stamps[0]) for part in series)


def read_window(bag: Bag, decoders: dict[str, TopicDecoder], begin: int, end: int) -> None:
    """Read the chunks that hold the stamps begin <= stamp < end, and every alignment.

    Chunks are indexed by time of arrival, which differs from the stamps by an unknown lag and,
    for a session recorded faster than real time, in rate. Both are bounded by reading on until
    the chunks on either side hold only earlier or later stamps.
    """
    places = [(i, p) for i in bag.files for p in i.chunks]
    places.sort(key=lambda item: item[1].start)

    @cache
    def latest(number: int) -> dict[str, int]:
        """Latest stamp of each topic in a chunk."""
        index, place = places[number]
        trial = {t: TopicDecoder(t, d.type_name, str(bag.path)) for t, d in main.items()}
        read_file(index, [place], {n: trial[t] for n, t in held(number).items()})
        return {
            topic: max(int(part.stamps[-1]) for part in series.values())
            for topic, decoder in trial.items()
            if (series := decoder.series())
        }

    def held(number: int) -> dict[int, str]:
        """Channel -> topic of what a chunk may hold."""
        index, place = places[number]
        return {
            n: c.topic
            for n, c in index.channels.items()
            if c.topic in main and (not place.index or n in place.index)
        }

    def inside(topic: str) -> range:
        """Chunks that hold the part of a topic, whose clock may be one of its own."""

        def latest_from(number: int) -> int:
            """Latest stamp in a chunk or the first after it that holds the topic."""
            holding = (n for n in range(number, len(places)) if topic in held(n).values())
            known = (latest(n)[topic] for n in holding if topic in latest(n))
            return next(known, _NEVER)

        chunks = range(len(places))
        # Neighbouring chunks overlap where messages of one moment arrive across a boundary.
        lower = max(bisect_left(chunks, begin, key=latest_from) - 1, 0)
        return chunks[lower : bisect_left(chunks, end, key=latest_from) + 2]

    main = {t: d for t, d in decoders.items() if t != names.ALIGNMENT}
    wanted = {(id(i), p.offset) for t in main for i, p in (places[n] for n in inside(t))}
    read_places(bag, main, lambda index, place: (id(index), place.offset) in wanted)
    if names.ALIGNMENT in decoders:
        latched = {names.ALIGNMENT: decoders[names.ALIGNMENT]}
        read_places(bag, latched, lambda index, place: True)
