"""Stamps: integer nanoseconds, subtracted before they become seconds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stage_core.arrays import Array

NANOSECONDS = 1_000_000_000
#: Lockstep on a Zaber line: every command line lets so much virtual time pass [ns]. About its wire
#: time at 115200 baud; a poll and a streamed move of two axes make a tick of 20 ms.
LOCKSTEP_EXCHANGE = 5_000_000


def to_seconds(stamps: NDArray[np.int64], start: int) -> Array:
    """Seconds since `start` [ns] of stamps [ns] of shape (n,).

    The difference is taken between integers: a double holds an epoch only to 0.2 µs.
    """
    return (np.asarray(stamps, dtype=np.int64) - np.int64(start)).astype(np.float64) * 1e-9


def to_stamps(seconds: Array, start: int) -> NDArray[np.int64]:
    """Stamps [ns] of shape (n,) at `seconds` after `start` [ns]."""
    return np.int64(start) + np.rint(np.asarray(seconds) * 1e9).astype(np.int64)


def split_stamp(stamp: int) -> tuple[int, int]:
    """Whole seconds and remaining nanoseconds of a stamp [ns]."""
    return stamp // NANOSECONDS, stamp % NANOSECONDS


def join_stamp(seconds: int, nanoseconds: int) -> int:
    """Stamp [ns] from the two fields of a message header."""
    return seconds * NANOSECONDS + nanoseconds
