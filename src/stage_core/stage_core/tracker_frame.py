"""Whether the points of a tracker can be in metres and in the frame of the stage."""

from __future__ import annotations

import numpy as np

from stage_core.arrays import Array

OTHER_UNIT = 10.0
"""Times that one topic moves as far as another: no error of a machine.

A frame that is turned changes the extent by 1.4 times at most; inches, degrees, millimetres and
micrometres by 25 and more.
"""
TURNED = 0.25
"""Share of a move that is seen along another axis, or not along its own: no error of a machine.

Squareness and scale come to 0.001; a tracker that is 40 ms late, on a circle of one second, to
0.25. Axes that are exchanged give 1.
"""


OUTER = 0.005
"""Share of values at either end that a wrong reading now and then may be among."""
SINGLE = 'has single values far from all others: cut that part out, or record it again'
"""What to say where a reading is wrong now and then."""


def other_unit(points: Array, positions: Array, than: str) -> str:
    """What to say where points (n, k) do not move as far as positions (m, axes), else empty.

    `than` names what the positions are of.
    """
    ratio = extent(points, 0.0) / max(extent(positions, 0.0), 1e-300)
    if 1.0 / OTHER_UNIT < ratio < OTHER_UNIT:
        return ''
    if extent(points, OUTER) < OTHER_UNIT * extent(positions, OUTER) and ratio > OTHER_UNIT:
        return SINGLE
    return f'moves {ratio:.4g} times as far as {than}: one of them is not in metres, mend its unit'


def extent(values: Array, outer: float) -> float:
    """Length [m] of the box of values (n, k) without a share of them at either end."""
    low, high = np.quantile(values, [outer, 1.0 - outer], axis=0)
    return float(np.linalg.norm(high - low))


def turned(points: Array, positions: Array) -> str:
    """What to say where points (n, axes) do not follow positions (n, axes), else empty."""
    travel = np.ptp(positions, axis=0)
    # An axis that rests tells nothing.
    moving = travel > 0.01 * travel.max()
    seen, moved = points[:, moving], positions[:, moving]
    linear = np.linalg.lstsq(moved - moved.mean(axis=0), seen - seen.mean(axis=0), rcond=None)[0]
    own = np.abs(np.diagonal(linear))
    if len(own) == 2 and min(abs(linear[0, 1]), abs(linear[1, 0])) > own.max():
        return 'x and y look exchanged: call /tracker_bridge/align, or mend the driver'
    if np.abs(linear - np.eye(len(own))).max() > TURNED:
        return 'the frame is turned or mirrored against the stage: call /tracker_bridge/align'
    return ''
