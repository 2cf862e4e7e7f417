"""Trapezoidal motion of one axis as pieces of constant acceleration, planned in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Piece:
    """Constant acceleration from `start` [s] on, for `duration` [s]; units of length are free."""

    start: float
    duration: float
    position: float
    velocity: float
    acceleration: float

    def at(self, time: float) -> tuple[float, float]:
        """Position and velocity at `time`, held to the piece's own span."""
        elapsed = min(max(time - self.start, 0.0), self.duration)
        return (
            self.position + (self.velocity + 0.5 * self.acceleration * elapsed) * elapsed,
            self.velocity + self.acceleration * elapsed,
        )

    @property
    def end(self) -> float:
        """Time at which it ends [s]."""
        return self.start + self.duration


class _Plan:
    def __init__(self, time: float, position: float, velocity: float) -> None:
        self.pieces: list[Piece] = []
        self.time, self.position, self.velocity = time, position, velocity

    def add(self, duration: float, acceleration: float) -> None:
        if duration > 0.0:
            piece = Piece(self.time, duration, self.position, self.velocity, acceleration)
            self.pieces.append(piece)
            self.time += duration
            self.position, self.velocity = piece.at(self.time)

    def change_velocity(self, velocity: float, acceleration: float) -> None:
        change = velocity - self.velocity
        self.add(abs(change) / acceleration, math.copysign(acceleration, change))
        self.velocity = velocity


def plan_stop(time: float, position: float, velocity: float, acceleration: float) -> list[Piece]:
    """Pieces from a state in motion to rest."""
    plan = _Plan(time, position, velocity)
    plan.change_velocity(0.0, acceleration)
    return plan.pieces


def plan_move(
    time: float,
    position: float,
    velocity: float,
    target: float,
    speed: float,
    acceleration: float,
) -> list[Piece]:
    """Pieces from a state in motion to rest at `target`, never above `speed` for long.

    Where the present velocity points away from the target or cannot be stopped before it, the
    axis first comes to rest, then returns.
    """
    plan = _Plan(time, position, velocity)
    direction = math.copysign(1.0, target - position)
    stopping = velocity**2 / (2.0 * acceleration)
    if velocity * direction < 0.0 or stopping > abs(target - position):
        plan.change_velocity(0.0, acceleration)
        direction = math.copysign(1.0, target - plan.position)
    if abs(plan.velocity) > speed:
        plan.change_velocity(direction * speed, acceleration)
    distance = abs(target - plan.position)
    now = abs(plan.velocity)
    # Highest speed of a triangle over the distance that starts at the present speed.
    peak = min(speed, math.sqrt(acceleration * distance + 0.5 * now**2))
    plan.change_velocity(direction * peak, acceleration)
    rest = abs(target - plan.position) - peak**2 / (2.0 * acceleration)
    if peak > 0.0:
        plan.add(rest / peak, 0.0)
    plan.change_velocity(0.0, acceleration)
    return plan.pieces
