"""Times of arrival and sequence numbers of a bag's messages."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from session_bags.bag import Bag
from session_bags.bulk import MESSAGE_RECORD
from session_bags.records import chunk_messages


@dataclass(frozen=True)
class Arrivals:
    """Of one topic: sequence numbers, arrival and publication [ns], each of shape (n,)."""

    sequence: NDArray[np.int64]
    log_time: NDArray[np.int64]
    publish_time: NDArray[np.int64]

    def missing(self) -> int:
        """Messages missing between those recorded, by their numbers; 0 where none are given.

        Numbers that go back belong to a second publisher or one that began anew: such a topic
        is not judged.
        """
        steps = np.diff(self.sequence)
        if not len(steps) or np.any(steps < 1):
            return 0
        return int(np.sum(steps - 1))


def arrivals(bag: Bag) -> dict[str, Arrivals]:
    """Arrivals per topic of an mcap bag, in the order of the file.

    Raises
    ------
    StageError
        If the bag is damaged.
    """
    heads: dict[str, list[NDArray[np.void]]] = {}
    size = MESSAGE_RECORD.itemsize
    for index in bag.files:
        with open(index.path, 'rb') as stream:
            for place in index.chunks:
                data, found = chunk_messages(stream, index.path, place)
                for channel, rows in found.items():
                    offsets = rows[:, 1].astype(np.int64)
                    if channel not in index.channels:
                        continue
                    windows = np.ndarray((len(data) - size + 1,), f'V{size}', data, 0, (1,))
                    topic = index.channels[channel].topic
                    heads.setdefault(topic, []).append(windows[offsets].view(MESSAGE_RECORD))
    return {
        topic: Arrivals(
            *(
                np.concatenate([block[name] for block in blocks]).astype(np.int64)
                for name in ('sequence', 'log_time', 'publish_time')
            )
        )
        for topic, blocks in heads.items()
    }
