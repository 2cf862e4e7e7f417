"""Ticks that scatter: the position that each misreads, and the time for which its force is held.

A position that is read late is ahead by the speed times the delay. A drive that reads late acts
late, too: its answer to the misread position is held for another time than the tick's, and does
not cancel. The mean of the recorded forces is then off by about
K_v · (1 - e^(-T·w)) · (std / T)² times the speed, with the gain K_v and the filter's corner w of
the velocity loop: a viscous friction that the machine does not have.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.input.data import Record
from gap_diagnosis.residuals.low_pass import band_limited, smooth
from gap_diagnosis.residuals.operators import central_difference, second_difference
from stage_core.arrays import Array

#: Hz, below which the motion is, and above which the moments of reading show.
MOTION = 30.0
#: Hz, of the balance that tells whether the drive acts when it reads.
SLOW = 3.0
EDGE = 0.2  # s at the ends, where the low-pass has no path


def forces_as_held(record: Record, i: int, mass: float, viscous: float) -> Array:
    """Mean force (n,) [N] of each tick: the recorded one, for as long as it was held.

    Where only the stamps scatter, the balance of forces does not ask for it, and the recorded
    forces are given back.
    """
    force, period = record.force[:, i], record.period
    if record.noise is None or not record.effort_recorded or not record.noise.axes[i].jitter:
        return force
    longer = np.diff(_late(record, i)[0], append=0.0) / period
    q = record.encoder[:, i]
    v, a = central_difference(q, period), second_difference(q, period)
    balance = force - mass * a - viscous * v
    slides = np.sign(smooth(v, period, MOTION))
    signals = np.column_stack([balance, force * longer, v, a, slides, np.ones_like(v)])
    inner = record.whole(record.time) & _inner(record)
    rows = smooth(signals, period, SLOW)[inner]
    asked = -np.linalg.lstsq(rows[:, 1:], rows[:, 0], rcond=None)[0][0]
    # 1 for a drive that acts when it reads, 0 for one whose stamps alone scatter.
    return np.asarray(force * (1.0 + longer)) if asked > 0.5 else force


def read_in_time(record: Record) -> Record:
    """The record with positions as they would be read at the ticks."""
    if record.noise is None or not any(noise.jitter for noise in record.noise.axes):
        return record
    ahead = [late * v for late, v in (_late(record, i) for i in range(len(record.axes)))]
    return replace(record, encoder=record.encoder - np.column_stack(ahead))


def _late(record: Record, i: int) -> tuple[Array, Array]:
    """How late each tick reads (n,) [s], and the speed (n,) [m/s] at which it shows that.

    What the position is ahead of its path, over the speed; weighed as a Wiener filter does against
    the noise of the position at rest. A wave that the encoder reads is no tick that is late.
    """
    assert record.noise is not None
    noise, q = record.noise.axes[i], record.motion(i)
    if not noise.jitter:
        return np.zeros_like(q), np.zeros_like(q)
    path = band_limited(q, record.period, MOTION)
    v = central_difference(path, record.period)
    late = (q - path) * v / (v**2 + (noise.position / noise.jitter) ** 2)
    return np.where(_inner(record), late, 0.0), v


def _inner(record: Record) -> NDArray[np.bool_]:
    return np.abs(record.time - record.time.mean()) < 0.5 * record.duration - EDGE
