"""What a Zaber stage is asked to do: follow a stream of velocities, or reach targets."""

from __future__ import annotations

import time

from stage_driver.limits import Setpoint, SetpointKind
from stage_driver.zaber_stage import Poll, ZaberStage


class ZaberMotion:
    """The set-point that is executed; at most one of `stream` and `targets` is there.

    Attributes
    ----------
    stream
        The newest set-point of a stream.
    targets
        Where a position move ends [microsteps].
    references
        Where the axes are asked to be [m]; empty before the first position is known.
    """

    def __init__(self) -> None:
        self.stream: Setpoint | None = None
        self.targets: list[int] | None = None
        self.references: list[float] = []
        self._since = 0.0

    def end(self) -> None:
        """Nothing is asked for any more."""
        self.stream = self.targets = None

    def take(self, stage: ZaberStage, setpoint: Setpoint, poll: Poll) -> str | None:
        """Execute a set-point from the place of `poll`; what went wrong, or None."""
        before = self.references or stage.metres(poll.steps)
        if setpoint.kind is not SetpointKind.VELOCITY:
            self.references = [
                before[index] if value is None else value
                for index, value in enumerate(setpoint.positions)
            ]
        self.end()
        if setpoint.streams:
            self.stream, self._since = setpoint, time.monotonic()
            return None
        self.targets = stage.steps(self.references)
        return stage.move(self.targets)

    def age(self) -> float:
        """Wall time since the stream's newest set-point [s]."""
        return time.monotonic() - self._since

    def send(self, stage: ZaberStage, poll: Poll) -> str | None:
        """Pass the stream's velocities on; what was refused, or None."""
        return None if self.stream is None else stage.stream(self._speeds(self.stream), poll.steps)

    def told(self, positions: list[float]) -> tuple[list[float], list[float]]:
        """References [m] and rates [m/s] of a stage that is at `positions` [m]."""
        if self.stream is None:
            return self.references or positions, [0.0] * len(positions)
        if self.stream.kind is SetpointKind.VELOCITY:
            self.references = positions
        return self.references or positions, self._speeds(self.stream)

    @staticmethod
    def _speeds(stream: Setpoint) -> list[float]:
        return [value or 0.0 for value in stream.velocities]
