"""Making an unfinished or damaged bag whole: the index, the summary and ``metadata.yaml``."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from session_bags import metadata
from session_bags.bag import mcap_files
from session_bags.container import ChunkMessages, ContainerWriter
from session_bags.definitions import typestore
from session_bags.records import (
    ChunkPlace,
    FileIndex,
    index_agrees,
    read_index,
    split_chunk,
    unpack_chunk,
    walk_messages,
)
from stage_core.errors import StageError, command_line
from stage_core.ownership import hold

#: Ending of the original file that a repaired one replaces.
KEPT_SUFFIX = '.unfinished'


@dataclass(frozen=True)
class Repaired:
    """What a repair found in one file, and kept."""

    path: Path
    messages: int
    lost_chunks: int
    lost_bytes: int
    was_whole: bool


def repair(path: str | Path) -> list[Repaired]:
    """Repair every mcap file of a bag in place and write its ``metadata.yaml``.

    The original of a file that was not whole stays beside it, its name ending in
    ``.unfinished``.

    Raises
    ------
    StageError
        If there is no mcap file, it holds no message, is still recorded, or the disk is full.
    """
    path = Path(path)
    files = mcap_files(path) if path.is_dir() else [path]
    if not files or not files[0].is_file():
        raise StageError(f'{path} holds no mcap file: name the directory of a session bag')
    old = _description(path) if path.is_dir() else None
    if old is not None and old.foreign:
        raise StageError(
            f'{path} holds compressed messages, which its description alone tells: it is left as '
            'it is; convert it with `rosbags-convert`'
        )
    done = [_repair_file(file) for file in files]
    kept = [file.path for file in done if file.messages or file.was_whole]
    if not kept:
        raise StageError(f'{path} holds no complete chunk of messages: nothing can be saved')
    if path.is_dir():
        _describe(path, old, kept)
    return done


def _repair_file(path: Path) -> Repaired:
    with open(path, 'rb') as held:
        if not hold(held):
            raise StageError(f'{path} is still recorded, or repaired by another: wait for its end')
        return _rewrite(path, read_index(path))


def _rewrite(path: Path, index: FileIndex) -> Repaired:
    target = path.with_name(path.name + '.repairing')
    try:
        with open(target, 'wb', buffering=0) as stream:
            container = ContainerWriter(stream)
            lost, agrees = _copy(index, container)
            os.fsync(stream.fileno())
        if index.finished and agrees and not lost:
            target.unlink()
            return Repaired(path, container.message_count, 0, 0, True)
        if not container.message_count:
            target.unlink()
            return Repaired(path, 0, lost, index.lost_bytes, False)
        kept = path.with_name(path.name + KEPT_SUFFIX)
        kept.unlink(missing_ok=True)
        _keep(path, kept)
        os.replace(target, path)
    except OSError as error:
        target.unlink(missing_ok=True)
        raise StageError(
            f'cannot repair {path} ({error.strerror}): free space and try again; the file is '
            'unchanged'
        ) from error
    return Repaired(path, container.message_count, lost, index.lost_bytes, False)


def _keep(path: Path, kept: Path) -> None:
    """Give a file a second name; where the file system has none, the first goes."""
    try:
        os.link(path, kept)
    except OSError:
        os.replace(path, kept)


def _copy(index: FileIndex, container: ContainerWriter) -> tuple[int, bool]:
    """Copy every whole chunk; the number of damaged ones, and whether the indexes were right."""
    lost, agrees = 0, True
    for schema in index.schemas.values():
        container.add_schema(schema)
    for channel in index.channels.values():
        container.add_channel(channel)
    with open(index.path, 'rb') as stream:
        for place in index.chunks:
            stream.seek(place.offset)
            raw = stream.read(max(place.length, place.index_end - place.offset))
            try:
                agrees &= _copy_chunk(index, place, raw, container)
            except StageError:
                lost += 1
    for name, content in index.metadata.items():
        container.add_metadata(name, content)
    container.finish()
    return lost, agrees


def _copy_chunk(
    index: FileIndex, place: ChunkPlace, raw: bytes, container: ContainerWriter
) -> bool:
    """Copy a chunk; whether its message indexes were right.

    Raises
    ------
    StageError
        If the chunk is damaged.
    """
    if place.bare:
        data = raw[: place.length]
        container.add_chunk(data, _known(index, walk_messages(data)))
        return True
    chunk = split_chunk(raw, index.path)
    found = walk_messages(unpack_chunk(chunk, index.path))
    container.add_compressed_chunk(chunk, _known(index, found))
    return not place.index or index_agrees(raw, place, found)


def _known(index: FileIndex, messages: ChunkMessages) -> ChunkMessages:
    return {channel: rows for channel, rows in messages.items() if channel in index.channels}


def _description(directory: Path) -> metadata.BagMetadata | None:
    try:
        return metadata.load(directory)
    except StageError:
        return None


def _describe(directory: Path, old: metadata.BagMetadata | None, files: Sequence[Path]) -> None:
    """Write ``metadata.yaml`` from the summaries of the files."""
    new = metadata.BagMetadata(custom_data=dict(old.custom_data) if old else {})
    topics: dict[str, metadata.TopicRecord] = {}
    for path in files:
        index = read_index(path)
        record = metadata.FileRecord(path.name, index.start, index.end, index.message_count)
        new.files.append(record)
        for key, value in metadata.inner_custom_data(index.metadata).items():
            new.custom_data.setdefault(key, value)
        for number, channel in index.channels.items():
            schema = index.schemas.get(channel.schema_id)
            type_name = schema.name if schema else ''
            topic = topics.setdefault(
                channel.topic,
                metadata.TopicRecord(
                    channel.topic,
                    type_name,
                    channel.metadata.get('topic_type_hash') or _type_hash(type_name),
                    metadata.parse_qos(channel.metadata.get('offered_qos_profiles')),
                ),
            )
            topic.count += index.counts.get(number, 0)
    new.topics = list(topics.values())
    new.save(directory)


def _type_hash(type_name: str) -> str:
    """RIHS01 hash of a type, empty where it is unknown here."""
    try:
        return typestore().hash_rihs01(type_name)
    except KeyError:
        return ''


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Repair the named bags and say what was saved."""
    parser = argparse.ArgumentParser(
        prog='repair', description='Make unfinished or damaged session bags whole.'
    )
    parser.add_argument('bag', nargs='+', help='directory of a bag, or an mcap file')
    for bag in parser.parse_args(arguments).bag:
        for done in repair(bag):
            if done.was_whole:
                print(f'{done.path}: whole, {done.messages} messages')
                continue
            if not done.messages:
                print(f'{done.path}: no complete chunk of messages, left out of the bag')
                continue
            print(
                f'{done.path}: repaired, {done.messages} messages saved, {done.lost_chunks} '
                f'damaged chunks and {done.lost_bytes} trailing bytes left out; the original is '
                f'{done.path.name}{KEPT_SUFFIX}'
            )
    return 0
