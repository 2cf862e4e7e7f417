"""Counting dropped messages from publication sequence numbers."""

from __future__ import annotations

from dataclasses import dataclass


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
