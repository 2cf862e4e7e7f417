"""A homing that was asked for before the stage is there."""

from __future__ import annotations

import time


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
