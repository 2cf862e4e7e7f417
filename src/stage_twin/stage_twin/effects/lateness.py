"""What latency and clock of the tracker have in common."""

from __future__ import annotations

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.rows import TrackerRows

STEP = 0.5e-3  # s


def lateness(rows: TrackerRows) -> Array:
    """A time error that changes with time in any smooth way: columns velocity · tᵏ."""
    velocity = rows.shifted(latency=-STEP)[:, 0] / STEP
    share = rows.session_share()
    return np.column_stack([velocity * share**k for k in range(3)])
