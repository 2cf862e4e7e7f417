"""What a backend is late with, and what it waits for."""

from __future__ import annotations

import time

#: A driver that is late by more has lost the motion: drives brake by themselves by then [s].
LATE_LIMIT = 0.02


class Lateness:
    """Ticks by which the driver is behind the drive, and whether the stage moved at the first."""

    def __init__(self, period: float) -> None:
        self._period = period
        self._ticks, self._moved = 0, False

    def add(self, ticks: int, moving: bool) -> None:
        """Count ticks that passed without a force."""
        if not self._ticks:
            self._moved = moving
        self._ticks += ticks

    @property
    def lost(self) -> bool:
        """Whether the drive has braked by now."""
        return self._ticks * self._period > LATE_LIMIT

    def clear(self) -> float:
        """Up to date again: by how much [s] a motion was late that the drive braked; else 0."""
        late = self._ticks * self._period if self._moved and self.lost else 0.0
        self._ticks = 0
        return late


class AwaitedHoming:
    """A homing that was asked for and waits up to `timeout` [s] of wall time for the stage.

    `wire` names what it waits for, `parameters` what says where that is.
    """

    def __init__(self, timeout: float, wire: str, parameters: str) -> None:
        self._timeout, self._wire, self._parameters = timeout, wire, parameters
        self._by: float | None = None

    @property
    def waiting(self) -> bool:
        """Whether it has not begun."""
        return self._by is not None

    def ask(self) -> str:
        """Begin to wait; says for what."""
        self._by = time.monotonic() + self._timeout
        return f'homing waits up to {self._timeout:g} s for the {self._wire}'

    def end(self) -> None:
        """Wait no longer."""
        self._by = None

    def given_up(self) -> str:
        """Why it waits no longer; empty while it does."""
        if self._by is None or time.monotonic() <= self._by:
            return ''
        return f'no {self._wire} within {self._timeout:g} s: start it, or check {self._parameters}'
