"""Many messages at once: columns to CDR, and CDR merged by time into chunks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from session_bags.cdr import JOINT_STATE, QUANTITIES, Bytes, blank_layout, encode
from session_bags.container import MESSAGE_HEADER, MESSAGE_RECORD
from stage_core import topics
from stage_core.errors import StageError
from stage_core.session import Series, Session

_PREFIX = MESSAGE_RECORD.itemsize


@dataclass(frozen=True)
class Block:
    """Messages of one size: log times (n,) [ns] and CDR bytes (n, size)."""

    topic: str
    times: NDArray[np.int64]
    rows: Bytes


def blocks_of(series: Series, key: str) -> list[Block]:
    """CDR messages of a series; `key` is its key in the session.

    A JointState leaves out a quantity that is NaN for all of its joints: set-points of position
    only and of velocity only may follow each other in one series.
    """
    type_name = topics.TOPIC_TYPES.get(series.topic)
    if type_name is None:
        raise StageError(
            f'{series.topic} is no topic of a session: see docs/reference/interfaces.md, "Topics"'
        )
    if type_name != JOINT_STATE:
        frame = topics.TRACKER_FRAME if series.topic.startswith('/tracker') else topics.STAGE_FRAME
        if series.topic == topics.TEMPERATURE:
            frame = key.partition(':')[2] or 'air'
        layout = blank_layout(type_name, frame)
        return [Block(series.topic, series.stamps, encode(layout, series.stamps, series.values))]
    joints = list(dict.fromkeys(name.partition('.')[2] for name in series.values))
    present = np.zeros(len(series), np.int64)
    for bit, quantity in enumerate(QUANTITIES):
        columns = [series.values.get(f'{quantity}.{joint}') for joint in joints]
        given = [column for column in columns if column is not None]
        if given and len(given) != len(joints):
            raise StageError(f'{series.topic} gives {quantity} for some joints only: give all')
        if given:
            present |= (~np.isnan(np.vstack(given)).all(axis=0)).astype(np.int64) << bit
    blocks = []
    for pattern in np.unique(present):
        mine = present == pattern
        quantities = [q for bit, q in enumerate(QUANTITIES) if pattern >> bit & 1]
        layout = blank_layout(type_name, topics.STAGE_FRAME, joints, quantities)
        columns_here = {name: column[mine] for name, column in series.values.items()}
        rows = encode(layout, series.stamps[mine], columns_here)
        blocks.append(Block(series.topic, series.stamps[mine], rows))
    return blocks


def session_blocks(session: Session) -> list[Block]:
    """CDR messages of every series of a session, and of its alignment at the start."""
    blocks = []
    for key, series in session.series.items():
        if len(series):
            blocks += blocks_of(series, key)
    if session.alignment is not None and blocks:
        layout = blank_layout(
            'geometry_msgs/msg/TransformStamped',
            topics.STAGE_FRAME,
            child_frame=topics.TRACKER_FRAME,
        )
        columns = {
            f'translation.{axis}': np.array([value])
            for axis, value in zip('xyz', session.alignment.translation, strict=True)
        } | {
            f'rotation.{axis}': np.array([value])
            for axis, value in zip('xyzw', session.alignment.quaternion(), strict=True)
        }
        stamps = np.array([min(int(b.times.min()) for b in blocks)], np.int64)
        blocks.append(Block(topics.ALIGNMENT, stamps, encode(layout, stamps, columns)))
    return blocks


def merge(
    blocks: Sequence[Block],
    channels: Sequence[int],
    chunk_bytes: int,
    written: Mapping[int, int],
) -> Iterator[tuple[bytes, dict[int, NDArray[np.uint64]]]]:
    """Message records of all blocks in order of time, cut into chunks.

    Yields the chunk's bytes and, per channel, rows of (log time, offset). Sequence numbers
    count from 1 in each channel, after the messages already `written`; publish time and log time
    are the same.
    """
    times = np.concatenate([block.times for block in blocks])
    source = np.repeat(np.arange(len(blocks)), [len(block.times) for block in blocks])
    within = np.concatenate([np.arange(len(block.times)) for block in blocks])
    order = np.argsort(times, kind='stable')
    times, source, within = times[order], source[order], within[order]
    channel_of = np.asarray(channels)[source]
    sequence = np.empty(len(times), np.uint32)
    for channel in set(channels):
        mine = channel_of == channel
        sequence[mine] = np.arange(1, np.count_nonzero(mine) + 1) + written.get(channel, 0)
    sizes = np.array([block.rows.shape[1] + _PREFIX for block in blocks])[source]
    ends = np.cumsum(sizes)
    begin = 0
    while begin < len(times):
        base = ends[begin] - sizes[begin]
        end = max(begin + 1, int(np.searchsorted(ends, base + chunk_bytes, side='right')))
        part = slice(begin, end)
        offsets = ends[part] - sizes[part] - base
        chunk = np.empty(int(ends[end - 1] - base), np.uint8)
        for number, block in enumerate(blocks):
            mine = np.flatnonzero(source[part] == number)
            if len(mine):
                rows = block.rows[within[part][mine]]
                records = _records(rows, channels[number], sequence[part][mine], times[part][mine])
                # One item per byte position: a whole record is assigned at each offset.
                item = f'V{records.shape[1]}'
                shape = (len(chunk) - records.shape[1] + 1,)
                np.ndarray(shape, item, chunk, 0, (1,))[offsets[mine]] = records.view(item)[:, 0]
        index = {}
        for channel in np.unique(channel_of[part]):
            mine = channel_of[part] == channel
            rows = np.column_stack([times[part][mine], offsets[mine]])
            index[int(channel)] = rows.astype(np.uint64)
        yield chunk.tobytes(), index
        begin = end


def _records(
    rows: Bytes, channel: int, sequence: NDArray[np.uint32], times: NDArray[np.int64]
) -> Bytes:
    """Message records (n, 31 + size) of messages (n, size)."""
    count, size = rows.shape
    header = np.empty(count, MESSAGE_RECORD)
    header['opcode'] = int(Opcode.MESSAGE)
    header['length'] = MESSAGE_HEADER + size
    header['channel'] = channel
    header['sequence'] = sequence
    header['log_time'] = times
    header['publish_time'] = times
    return np.hstack([header.view(np.uint8).reshape(count, _PREFIX), rows])
