"""What a backend tells the node, and a controller that the driver's own process holds."""

from __future__ import annotations

from collections.abc import Sequence
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
