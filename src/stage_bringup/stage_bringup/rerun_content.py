"""What a session bag holds beside its arrays: two clocks, alignments, states, models."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from session_bags.bag import Bag, open_bag
from session_bags.definitions import typestore
from session_bags.messages import raw_messages
from session_bags.reader import read_session
from stage_core import topics
from stage_core.frames import RigidTransform, alignment_in
from stage_core.session import Session

Stamps = NDArray[np.int64]
LEVELS = ('INFO', 'WARN', 'ERROR', 'CRITICAL')


@dataclass(frozen=True)
class Note:
    """What one node said of itself, once it changed: name, level of `LEVELS`, sentence."""

    stamp: int
    name: str
    level: str
    text: str


@dataclass(frozen=True)
class Recorded:
    """A session, its clocks and its rare messages."""

    session: Session
    #: Stamps and wall time of the same messages [ns], both ascending, shape (n,).
    stamps: Stamps
    wall: Stamps
    alignments: list[tuple[int, RigidTransform]]
    notes: list[Note]
    models: list[tuple[int, str]]

    def wall_time(self, stamps: Stamps) -> Stamps:
        """Wall time [ns] at stamps [ns], between messages by interpolation, shape (n,)."""
        if not len(self.stamps):
            return stamps
        # Beside the ends both clocks run alike. Differences: a double holds no epoch to 1 ns.
        inside = np.clip(stamps, self.stamps[0], self.stamps[-1])
        known = (self.stamps - self.stamps[0]).astype(float)
        since = np.interp(inside - self.stamps[0], known, (self.wall - self.wall[0]).astype(float))
        return self.wall[0] + np.rint(since).astype(np.int64) + (stamps - inside)


def read_recorded(path: str | Path) -> Recorded:
    """Read a bag.

    Raises
    ------
    StageError
        As `session_bags.reader.read_session`.
    """
    bag = open_bag(path)
    session = read_session(path)
    alignments: list[tuple[int, RigidTransform]] = []
    notes: list[Note] = []
    models: list[tuple[int, str]] = []
    times: list[tuple[int, int]] = []
    said: dict[str, tuple[str, str]] = {}
    for stamp, published, topic, message in _rare(bag):
        times.append((stamp, published))
        if topic == topics.ALIGNMENT:
            alignments.append((stamp, alignment_in(message)))
        elif topic == topics.MODEL:
            models.append((stamp, message.data))
        else:
            notes += _changes(stamp, message, said)
    ascending = np.array(sorted(set(times)), np.int64).reshape(-1, 2)
    wall = np.maximum.accumulate(ascending[:, 1])
    return Recorded(session, ascending[:, 0], wall, alignments, notes, models)


def _rare(bag: Bag) -> Iterator[tuple[int, int, str, Any]]:
    """Stamp, wall time [ns], topic and message of what is said rarely."""
    wanted = (topics.ALIGNMENT, topics.MODEL, topics.DIAGNOSTICS)
    for raw in raw_messages(bag, wanted):
        message = typestore().deserialize_cdr(raw.data, raw.type_name)
        # On one clock a message is published before it is logged. Simulated time begins in 1970.
        yield raw.log_time, max(raw.log_time, raw.publish_time), raw.topic, message


def _changes(stamp: int, message: Any, said: dict[str, tuple[str, str]]) -> Iterator[Note]:
    """States that differ from what the same node `said` last."""
    for status in message.status:
        state = (LEVELS[min(int(status.level), len(LEVELS) - 1)], str(status.message))
        if said.get(status.name) != state:
            said[status.name] = state
            yield Note(stamp, str(status.name), *state)
