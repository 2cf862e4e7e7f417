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
        Where a position move ends [microsteps]; None for an axis that just comes to rest.
    references
        Where the axes are asked to be [m]; empty where that is wherever they are.
    """

    def __init__(self) -> None:
        self.stream: Setpoint | None = None
        self.targets: list[int | None] | None = None
        self.references: list[float] = []
        self._since = 0.0

    def end(self) -> None:
        """Nothing is asked for any more."""
        self.stream = self.targets = None

    def take(self, stage: ZaberStage, setpoint: Setpoint, poll: Poll) -> str | None:
        """Execute a set-point from the place of `poll`; what went wrong, or None."""
        before = self.references or stage.metres(poll.steps)
        places = [
            before[index] if value is None else value
            for index, value in enumerate(setpoint.positions)
        ]
        # Nobody knows yet where an axis comes to rest that still brakes and is asked nothing.
        braking = [
            busy and value is None and not self.references
            for busy, value in zip(poll.busy, setpoint.positions, strict=True)
        ]
        if setpoint.kind is not SetpointKind.VELOCITY:
            self.references = [] if any(braking) else places
        self.end()
        if setpoint.streams:
            self.stream, self._since = setpoint, time.monotonic()
            return None
        steps = stage.steps(places)
        self.targets = [None if b else step for b, step in zip(braking, steps, strict=True)]
        return stage.move(self.targets)

    def missed(self, poll: Poll) -> bool:
        """Whether a position move that is over ended before its targets."""
        targets = self.targets or [None] * len(poll.steps)
        return any(t not in (None, step) for t, step in zip(targets, poll.steps, strict=True))

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
            self.references = []
        return self.references or positions, self._speeds(self.stream)

    @staticmethod
    def _speeds(stream: Setpoint) -> list[float]:
        return [value or 0.0 for value in stream.velocities]
