"""Where the held-out windows lie: so that the gap shows in them as it does beside them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gap_diagnosis.closed_loop.replay import replay
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import LAST_THIRD, STARTED, scored_ticks
from stage_core.twin_file import TwinFile

#: Share of the squared gap of an encoder that the held-out windows hold, at least and at most:
#: 0.12 to 0.70 on 146 axes of 78 sessions; on four others, where it opens for a moment, less than
#: 0.05 or more than 0.99.
LEAST_HELD, MOST_HELD = 0.1, 0.9
#: Places of the windows in their blocks that are tried: so near to one another that an edge cuts a
#: gap that opens once for a tenth of a second.
STEPS = 41


def with_windows(record: Record, twin: TwinFile) -> Record:
    """The record with its windows where the least of a servo twin's nominal gap is lost.

    They stay in the last third of each block unless they hold almost nothing of the gap of an
    axis, or almost all of it: then no fit could be judged by them.
    """
    if record.held_out_session:
        return record
    gaps = [g for n, g in replay(record, twin, {}).items() if n.startswith('encoder')]
    squares = np.square(gaps) * (record.time > STARTED)

    def shares(place: float) -> list[float]:
        rows = scored_ticks(replace(record, windows_at=place))
        return [float(own[rows].sum() / own.sum()) for own in squares if own.any()]

    if all(LEAST_HELD <= share <= MOST_HELD for share in shares(LAST_THIRD)):
        return record
    places = [float(place) for place in np.linspace(LAST_THIRD, 0.0, STEPS)]
    held = {p: own for p in places if min(own := shares(p)) >= LEAST_HELD}
    if not held:
        return record
    # A third of the time should hold a third of the gap.
    best = min(held, key=lambda p: max(abs(share - 1.0 / 3.0) for share in held[p]))
    return replace(record, windows_at=best)
