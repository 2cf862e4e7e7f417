"""What a node would hear in a session, given to its live buffer."""

from __future__ import annotations

from collections.abc import Iterator

from calibrator.live_buffer import LiveBuffer
from stage_core import topics
from stage_core.session import Session


def hear(buffer: LiveBuffer, session: Session) -> Iterator[int]:
    """Hear a session of `grid_session`: the number of each reference, as soon as it is heard."""
    reference, points = session.series[topics.REFERENCE], session.series[topics.TRACKER_POINT]
    rows = reference.columns('position', ('x', 'y'))
    for k, stamp in enumerate(reference.stamps):
        buffer.add_reference(int(stamp), ('x', 'y'), rows[k])
        if k % 5 == 0:
            point = [points.values[axis][k // 5] for axis in 'xyz']
            buffer.add_point(int(points.stamps[k // 5]), point)
        yield k
