"""Windows of a session that no fit sees: what a diagnosis is judged by."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.input.checks import least_travel
from stage_core.arrays import Array

if TYPE_CHECKING:
    from gap_diagnosis.input.data import Record

Mask = NDArray[np.bool_]
#: Of a record the ticks (n,) that count.
Ticks = Callable[['Record'], Mask]

LAST_THIRD = 2.0 / 3.0  # of a block: where its held-out window begins
STARTED = 0.5  # s after which the replayed loop has forgotten how the recorded one began
PREFIX = 0.15  # share of a held-out session in which its nuisances are refitted, unscored


def held_out_windows(record: Record) -> list[tuple[float, float]]:
    """Windows [s] that no fit sees.

    The last third of each block of about 5 s (10 s of a session beyond two minutes) or the one
    that begins at `record.windows_at`, or every third rest; of a held-out session everything after
    the prefix in which its own nuisances are refitted.
    """
    if record.held_out_session:
        return [(float(record.time[0] + PREFIX * record.duration), float(record.time[-1]))]
    if record.row_noise is not None and record.tracker_time is not None:
        # Rests are few: every third one is held out, whatever the rhythm of the moves.
        middle = 0.5 * (record.tracker_time[1:] + record.tracker_time[:-1])
        bounds = np.concatenate([record.time[:1], middle, record.time[-1:]])
        return [(float(bounds[i]), float(bounds[i + 1])) for i in range(2, len(bounds) - 1, 3)]
    blocks = max(3, round(record.duration / (5.0 if record.duration < 120.0 else 10.0)))
    length = record.duration / blocks
    starts = [(i + record.windows_at) * length for i in range(blocks)]
    return [(start, start + length / 3.0) for start in starts]


def inside(time: Array, windows: list[tuple[float, float]]) -> Mask:
    """Which of the times (n,) [s] lie in one of the windows."""
    mask = np.zeros(len(time), dtype=bool)
    for start, stop in windows:
        mask |= (time >= start) & (time < stop)
    return mask


def scored_ticks(record: Record) -> Mask:
    """Ticks (n,) of the held-out windows, those near lost ones left out."""
    return inside(record.time, held_out_windows(record)) & record.whole(record.time)


def fitted_ticks(record: Record) -> Mask:
    """Ticks (n,) that a fit of the replayed loop sees, those near lost ones left out."""
    seen = ~inside(record.time, held_out_windows(record)) & (record.time > STARTED)
    return seen & record.whole(record.time)


def judging(records: Sequence[Record]) -> list[Record]:
    """Records that judge: whole held-out sessions, if there are any."""
    return [r for r in records if r.held_out_session] or list(records)


def moves_while_judged(records: Sequence[Record], i: int) -> bool:
    """Whether an axis moves in the held-out windows of any record that is judged."""
    paths = [(r, r.encoder[scored_ticks(r), i]) for r in judging(records) if r.moving[i]]
    return any(len(q) > 0 and float(np.ptp(q)) > least_travel(r, i) for r, q in paths)
