"""What the packets of the Leica emScon TPI hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stage_core.errors import StageError


class TpiError(StageError):
    """Bytes that are no TPI packet: the stream is lost and must be opened again."""


# One record of a multi-measurement packet and of its successor with covariances. Offsets are
# explicit because the doubles are aligned to 4 bytes only.
POINT = np.dtype(
    {
        'names': ['status', 'seconds', 'microseconds', 'values'],
        'formats': ['<i4', '<i4', '<i4', ('<f8', 3)],
        'offsets': [0, 4, 8, 12],
        'itemsize': 36,
    }
)
POINT_2 = np.dtype(
    {
        'names': [*(POINT.names or ()), 'standard_deviations', 'total', 'covariances'],
        'formats': ['<i4', '<i4', '<i4', ('<f8', 3), ('<f8', 3), '<f8', ('<f8', 3)],
        'offsets': [0, 4, 8, 12, 36, 60, 68],
        'itemsize': 92,
    }
)


@dataclass(frozen=True)
class CommandPacket:
    """A command to the tracker with its 32-bit arguments."""

    command: int
    arguments: tuple[int, ...] = ()


@dataclass(frozen=True)
class Answer:
    """The tracker's answer to a command; ``payload`` holds what follows the status."""

    command: int
    status: int
    payload: bytes = b''


@dataclass(frozen=True)
class ErrorPacket:
    """An unsolicited error."""

    command: int
    status: int


@dataclass(frozen=True)
class StatusChange:
    """An unsolicited event of the tracker (see `Event`)."""

    event: int


@dataclass(frozen=True)
class SingleMeasurement:
    """One stationary point, with its standard deviations, in the units set."""

    status: int
    mode: int
    tries: int
    values: tuple[float, float, float]
    standard_deviations: tuple[float, float, float]
    total_deviation: float
    temperature: float
    pressure: float
    humidity: float


@dataclass(frozen=True, eq=False)
class MultiMeasurement:
    """Points of a continuous measurement: structured array of dtype `POINT` or `POINT_2`."""

    status: int
    mode: int
    tries: int
    temperature: float
    pressure: float
    humidity: float
    points: np.ndarray

    def times_ns(self) -> np.ndarray:
        """Return the controller's time of every point, (n,) int64 [ns]."""
        seconds = self.points['seconds'].astype(np.int64)
        return seconds * 1_000_000_000 + self.points['microseconds'].astype(np.int64) * 1000


@dataclass(frozen=True)
class OtherPacket:
    """A valid packet of a type that carries nothing for this bridge."""

    type: int
    payload: bytes


ServerPacket = (
    Answer | ErrorPacket | StatusChange | SingleMeasurement | MultiMeasurement | OtherPacket
)
