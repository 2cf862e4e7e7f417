"""Messages of one topic to columns, a block at a time."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from session_bags.cdr import Bytes, Layout, LayoutError, layout_of
from session_bags.definitions import typestore
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.session import Series

Indices = NDArray[np.int64]

#: A topic with more layouts than this is decoded message by message.
_MAX_LAYOUTS = 16
_BIG_ENDIAN = b'\x00\x00'


@dataclass
class _Part:
    """Messages that share a frame and the same columns."""

    layout: Layout
    order: list[Indices] = field(default_factory=list)
    stamps: list[NDArray[np.int64]] = field(default_factory=list)
    values: list[Array] = field(default_factory=list)

    def add(self, order: Indices, rows: Bytes) -> None:
        """Append messages (n, size) that agree with the layout."""
        records = rows.reshape(-1).view(self.layout.record())
        seconds = records['sec'].astype(np.int64)
        self.stamps.append(seconds * 1_000_000_000 + records['nanosec'])
        values = np.empty((len(self.layout.fields), len(rows)))
        for row, (name, _) in zip(values, self.layout.fields, strict=True):
            row[:] = records[name]
        self.values.append(values)
        self.order.append(order)

    def take(
        self, data: Bytes, offsets: Indices, sizes: Indices, pending: Indices, base: int
    ) -> NDArray[np.bool_]:
        """Decode those of the pending messages that agree with the layout; which ones."""
        size = self.layout.size
        taken = sizes[pending] == size
        chosen = pending if taken.all() else pending[taken]
        if not len(chosen):
            return taken
        # One item per byte position, so that an index copies a whole message.
        windows = np.ndarray((len(data) - size + 1,), f'V{size}', data, 0, (1,))
        rows = windows[offsets[chosen]].view(np.uint8).reshape(-1, size)
        differs = (rows ^ self.layout.template) & self.layout.mask
        if differs.any():
            agrees = ~differs.any(axis=1)
            taken[np.flatnonzero(taken)[~agrees]] = False
            chosen, rows = chosen[agrees], rows[agrees]
        if len(chosen):
            self.add(chosen + base, rows)
        return taken


class TopicDecoder:
    """Collects the messages of one numeric topic as columns."""

    def __init__(self, topic: str, type_name: str, source: str) -> None:
        self.topic = topic
        self.type_name = type_name
        self._source = source
        self._parts: list[_Part] = []
        self._odd: dict[tuple[Any, ...], _Part] = {}
        self.count = 0

    def feed(self, data: Bytes, offsets: Indices, sizes: Indices) -> None:
        """Decode the messages at `offsets` with the given sizes in `data`.

        Raises
        ------
        StageError
            If the bytes are no message of the topic's type.
        """
        base = self.count
        self.count += len(offsets)
        pending = np.arange(len(offsets))
        known = iter(list(self._parts))
        while len(pending):
            part = next(known, None)
            if part is None:
                if len(self._parts) >= _MAX_LAYOUTS:
                    self._feed_singly(data, offsets[pending], sizes[pending], pending + base)
                    return
                begin, size = int(offsets[pending[0]]), int(sizes[pending[0]])
                raw = data[begin : begin + size].tobytes()
                layout, native = self._layout(raw)
                if native is not raw:
                    self._feed_singly(data, offsets[pending], sizes[pending], pending + base)
                    return
                part = _Part(layout)
                self._parts.append(part)
            taken = part.take(data, offsets, sizes, pending, base)
            pending = pending[~taken]

    def _layout(self, raw: bytes) -> tuple[Layout, bytes]:
        """Layout of a message, and the message in little-endian order."""
        try:
            if raw[:2] == _BIG_ENDIAN:
                store = typestore()
                message = store.deserialize_cdr(raw, self.type_name)
                raw = bytes(store.serialize_cdr(message, self.type_name))
            return layout_of(self.type_name, raw), raw
        except (LayoutError, ValueError, AssertionError, IndexError, TypeError) as error:
            raise StageError(
                f'{self._source}: message {self.count} or one before it on {self.topic} is no '
                f'{self.type_name} ({error}): record the session again'
            ) from error

    def _feed_singly(self, data: Bytes, offsets: Indices, sizes: Indices, order: Indices) -> None:
        for begin, size, number in zip(offsets, sizes, order, strict=True):
            layout, raw = self._layout(data[begin : begin + size].tobytes())
            key = (layout.size, layout.frame, layout.child_frame, layout.fields)
            part = self._odd.setdefault(key, _Part(layout))
            part.add(np.array([number]), np.frombuffer(raw, np.uint8).reshape(1, -1))

    def frames(self) -> list[tuple[str, str]]:
        """Frame and child frame of the messages met, each once."""
        parts = [*self._parts, *self._odd.values()]
        return list(dict.fromkeys((p.layout.frame, p.layout.child_frame) for p in parts))

    def last_frame(self) -> str:
        """Frame of the message with the last stamp; empty where there is no message."""
        parts = [p for p in (*self._parts, *self._odd.values()) if p.order]
        newest = [
            max(zip(np.concatenate(p.stamps), np.concatenate(p.order), strict=True)) for p in parts
        ]
        return parts[newest.index(max(newest))].layout.frame if parts else ''

    def series(self) -> dict[str, Series]:
        """Series by key, in order of stamps; a temperature has one per sensor.

        A column that some messages lack (a set-point without velocity) is NaN there. The decoder
        is empty afterwards.
        """
        parts = [p for p in (*self._parts, *self._odd.values()) if p.order]
        self._parts, self._odd = [], {}
        groups: dict[str, list[_Part]] = {}
        for part in parts:
            is_sensor = self.type_name == 'sensor_msgs/msg/Temperature'
            key = f'{self.topic}:{part.layout.frame}' if is_sensor else self.topic
            groups.setdefault(key, []).append(part)
        return {key: self._join(group) for key, group in groups.items()}

    def _join(self, parts: list[_Part]) -> Series:
        names = list(dict.fromkeys(name for part in parts for name, _ in part.layout.fields))
        order = np.concatenate([block for part in parts for block in part.order])
        stamps = np.concatenate([block for part in parts for block in part.stamps])
        values = np.full((len(names), len(stamps)), np.nan)
        begin = 0
        for part in parts:
            rows = [names.index(name) for name, _ in part.layout.fields]
            for block in part.values:
                values[rows, begin : begin + block.shape[1]] = block
                begin += block.shape[1]
            part.values.clear()
        if len(parts) > 1:
            arrival = np.argsort(order, kind='stable')
            stamps, values = stamps[arrival], values[:, arrival]
        if len(stamps) > 1 and np.any(np.diff(stamps) < 0):
            by_stamp = np.argsort(stamps, kind='stable')
            stamps, values = stamps[by_stamp], values[:, by_stamp]
        return Series(self.topic, stamps, dict(zip(names, values, strict=True)))

    def unsorted(self) -> bool:
        """Whether a message was stamped earlier than the one before it."""
        parts = [p for p in (*self._parts, *self._odd.values()) if p.order]
        if not parts:
            return False
        order = np.concatenate([block for part in parts for block in part.order])
        stamps = np.concatenate([block for part in parts for block in part.stamps])
        return bool(np.any(np.diff(stamps[np.argsort(order, kind='stable')]) < 0))

    def not_a_number(self) -> str | None:
        """Column and stamp of the first value that is NaN or infinite; None if all are finite."""
        for part in (*self._parts, *self._odd.values()):
            for stamps, values in zip(part.stamps, part.values, strict=True):
                bad = ~np.isfinite(values)
                if bad.any():
                    column, message = np.argwhere(bad)[0]
                    return f'{part.layout.fields[column][0]} at stamp {stamps[message]} ns'
        return None
