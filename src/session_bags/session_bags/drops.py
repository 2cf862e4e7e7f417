"""Counting dropped messages from publication sequence numbers, while recording and in a bag."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from session_bags.bag import Bag
from session_bags.records import chunk_messages, heads


@dataclass
class DropCounter:
    """Messages of one topic: received, and missing between those received.

    A publisher numbers its messages without gaps. The number does not say which publisher it
    is, so a topic with several of them is not counted.
    """

    received: int = 0
    dropped: int = 0
    several_publishers: bool = False
    _last: int | None = None

    def add(self, sequence: int) -> None:
        """Count one message; a number that does not grow is a publisher that started anew."""
        self.received += 1
        if self._last is not None and sequence > self._last:
            self.dropped += sequence - self._last - 1
        self._last = sequence

    @property
    def known_drops(self) -> int | None:
        """Dropped messages; None where they cannot be counted."""
        return None if self.several_publishers else self.dropped


def missing_messages(bag: Bag) -> dict[str, int]:
    """Per topic of an mcap bag, the messages missing between those recorded; 0 if not known.

    Numbers that go back belong to a second publisher or one that began anew: such a topic is not
    judged.

    Raises
    ------
    StageError
        If the bag is damaged.
    """
    numbers: dict[str, list[NDArray[np.int64]]] = {}
    for index in bag.files:
        with open(index.path, 'rb') as stream:
            for place in index.chunks:
                data, found = chunk_messages(stream, index.path, place)
                for number in found.keys() & index.channels.keys():
                    known = numbers.setdefault(index.channels[number].topic, [])
                    known.append(heads(data, found[number][:, 1])['sequence'].astype(np.int64))
    steps = {topic: np.diff(np.concatenate(blocks)) for topic, blocks in numbers.items()}
    return {
        topic: 0 if np.any(step < 1) else int(np.sum(step - 1)) for topic, step in steps.items()
    }
