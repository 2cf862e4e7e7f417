"""What the node asks of a backend, and what a backend tells the node."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Protocol

from stage_driver.states import State

#: Levels of events, as in diagnostic_msgs.
INFO, WARNING, FAILURE = 0, 1, 2


class Listener(Protocol):
    """Receives samples and events in the backend's thread; stamps in ns, SI units."""

    def on_measured(self, stamp: int, positions: Sequence[float]) -> None:
        """Take measured positions [m] before the force of their tick is computed.

        A set-point that is submitted in here belongs to this tick.
        """

    def on_state(
        self, stamp: int, positions: Sequence[float], velocities: Sequence[float]
    ) -> None:
        """Take measured positions [m] and velocities [m/s] of one tick."""

    def on_control(
        self,
        stamp: int,
        references: Sequence[float],
        rates: Sequence[float],
        commands: Sequence[float],
        forces: Sequence[float],
    ) -> None:
        """Take r_k [m], dr_k [m/s], vc_k [m/s] and F_k [N] (empty for a stepper) of one tick."""

    def on_temperatures(self, stamp: int, sensors: Sequence[str], values: Sequence[float]) -> None:
        """Take the temperature sensors [degC]."""

    def on_event(self, level: int, text: str) -> None:
        """Take something worth a log line."""


class Controller(Protocol):
    """A controller in the driver's own process; called in the backend's thread, must not wait."""

    def measured(self, stamp: int, positions: Sequence[float]) -> None:
        """Take positions [m] in the order of the axes; answer by `StageDriver.take`."""

    def told(self) -> None:
        """Publish what was kept back: the force of the tick is on its way."""


@dataclass(frozen=True)
class Status:
    """What `/diagnostics` shows of a backend."""

    state: State
    reason: str
    homed: bool
    connected: bool
    details: dict[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


class Backend(Protocol):
    """A stage behind a wire. No call blocks: futures are resolved by the backend's thread."""

    def start(self) -> None:
        """Open the wire and start the thread; StageError where that is impossible."""

    def close(self) -> None:
        """Bring the stage to rest, end the thread, close the wire."""

    def submit(
        self,
        stamp: int,
        names: Sequence[str],
        positions: Sequence[float],
        velocities: Sequence[float],
    ) -> None:
        """Check a set-point and hand it over; a refused one is an event and moves nothing."""

    def home(self) -> Future[str]:
        """Home all axes; the future ends when they are home, or fails with a StageError."""

    def stop(self) -> str:
        """Start a controlled stop and return at once."""

    def reset_fault(self) -> Future[str]:
        """Clear a latched fault."""

    def enable(self, on: bool) -> Future[str]:
        """Enable or disable the stage."""

    def status(self) -> Status:
        """State and counters of now."""
