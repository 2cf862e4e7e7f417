"""What a bag holds, in the words of ``ros2 bag info``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

from session_bags.bag import Bag, open_bag
from session_bags.records import chunk_messages
from stage_core.errors import StageError, command_line


@dataclass(frozen=True)
class Contents:
    """Messages per topic and the span of their arrival [ns]."""

    counts: dict[str, int]
    start: int
    end: int


def contents(bag: Bag) -> Contents:
    """Count the messages of a bag; an unfinished file is walked."""
    if bag.description.foreign:
        files = [record for record in bag.description.files if record.count]
        return Contents(
            {topic.name: topic.count for topic in bag.description.topics},
            min((record.start for record in files), default=0),
            max((record.end for record in files), default=0),
        )
    counts = dict.fromkeys(bag.topic_types(), 0)
    starts, ends = [], []
    for index in bag.files:
        by_channel = dict(index.counts)
        if index.finished and index.message_count:
            starts.append(index.start)
            ends.append(index.end)
        if not index.finished:
            with open(index.path, 'rb') as stream:
                for place in index.chunks:
                    _, found = chunk_messages(stream, index.path, place)
                    for channel, rows in found.items():
                        by_channel[channel] = by_channel.get(channel, 0) + len(rows)
                        starts.append(int(rows[:, 0].min()))
                        ends.append(int(rows[:, 0].max()))
        for channel, count in by_channel.items():
            if channel in index.channels:
                counts[index.channels[channel].topic] += count
    return Contents(counts, min(starts, default=0), max(ends, default=0))


def describe(path: str | Path) -> str:
    """Text of ``ros2 bag info``, with the custom data and warnings of the bag."""
    bag = open_bag(path)
    found = contents(bag)
    types = bag.topic_types()
    directory = bag.path if bag.path.is_dir() else bag.path.parent
    names = [index.path.name for index in bag.files] or [r.path for r in bag.description.files]
    try:
        size = sum((directory / name).stat().st_size for name in names)
    except OSError as error:
        raise StageError(
            f'{directory} lacks {error.filename} ({error.strerror}): copy the whole directory of '
            'the bag'
        ) from error
    lines = [
        ('Files:', '\n'.join(names)),
        ('Bag size:', f'{size / 2**20:.1f} MiB'),
        ('Storage id:', bag.description.storage),
        ('ROS Distro:', 'jazzy'),
        ('Duration:', f'{(found.end - found.start) * 1e-9:.9f}s'),
        ('Start:', _moment(found.start)),
        ('End:', _moment(found.end)),
        ('Messages:', str(sum(found.counts.values()))),
        (
            'Topic information:',
            '\n'.join(
                f'Topic: {topic} | Type: {types[topic]} | Count: {count} | '
                'Serialization Format: cdr'
                for topic, count in sorted(found.counts.items())
            ),
        ),
        ('Custom data:', ', '.join(sorted(bag.description.custom_data)) or 'none'),
    ]
    lines += [('Warning:', warning) for warning in bag.warnings]
    text = ''
    for label, value in lines:
        indent = '\n' + ' ' * 19
        text += f'{label:<19}{value.replace(chr(10), indent)}\n'
    return text


def _moment(stamp: int) -> str:
    """Date and seconds of a stamp [ns]."""
    date = datetime.fromtimestamp(stamp // 1_000_000_000, timezone.utc)
    fraction = stamp % 1_000_000_000
    return f'{date:%b %d %Y %H:%M:%S}.{fraction:09d} ({stamp // 1_000_000_000}.{fraction:09d})'


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Print what a bag holds."""
    parser = argparse.ArgumentParser(prog='info', description='Print what a session bag holds.')
    parser.add_argument('bag', help='directory of a bag, or an mcap file')
    print(describe(parser.parse_args(arguments).bag), end='')
    return 0
