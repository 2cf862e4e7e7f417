"""What a run of a contour goes through, what it sends, and its settings."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

Pair = tuple[float, float]


class Phase(Enum):
    """Where a run stands."""

    APPROACH = 'moving to the start'
    STREAM = 'following the contour'
    STOPPING = 'stopping'
    DONE = 'done'


@dataclass(frozen=True)
class SetPoint:
    """A set-point [m], [m/s] with the stamp [ns] of its tick."""

    stamp: int
    position: Pair
    velocity: Pair | None = None


@dataclass(frozen=True)
class RunSettings:
    """How a run approaches and stops.

    Attributes
    ----------
    start_tolerance
        Largest distance from the start point at which the contour begins [m].
    approach_timeout
        Time to reach the start point [s].
    stop_time
        Duration of a feed hold [s].
    lockstep
        Wait for `world_is_quiet` before the first tick, which keeps results identical.
    missed_share
        Largest share of ticks without a message from which is still learned.
    longest_step
        Way of the contour that may go by without a message [m]. The set-point after it is a step
        of that length to the driver, whose following error limit is a latched fault.
    """

    start_tolerance: float = 1e-4
    approach_timeout: float = 30.0
    stop_time: float = 0.2
    lockstep: bool = False
    missed_share: float = 0.05
    longest_step: float = 1e-3
