"""Age of a tracker point at its stamp."""

from __future__ import annotations

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.lateness import lateness
from stage_twin.effects.rows import TrackerRows
from stage_twin.effects.term import Term

EFFECT = Effect(
    name='tracker_latency',
    link='sensor',
    parameters=(Parameter('latency', 's', -0.1, 0.1, 2e-3, 'age of a point at its stamp'),),
    model='The point shows the table at stamp - latency. Muralikrishnan, Phillips, Sawyer, "Laser '
    'trackers for large-scale dimensional metrology: a review", Precision Engineering 44 (2016).',
    sentence='a tracker point is {latency} old at its stamp',
    excited_by='fast strokes in both directions',
    per_axis=False,
    seen_by_encoder=False,
)


def true_time(stamps: Array, latency: float) -> Array:
    """Time [s] at which the table was where points of these stamps show it."""
    return stamps - latency


signature = lateness


def term(rows: TrackerRows) -> Term | None:
    """Where the table was earlier (θ), less where it is."""
    if rows.rests:
        return None
    known = sum(frame.latency for frame in rows.frames)
    grid = [s * v for v in np.geomspace(1e-4, 0.05, 12) for s in (1.0, -1.0)]
    return Term(
        lambda theta: rows.shifted(latency=theta[0]),
        lambda theta, c: {'latency': known + theta[0]},
        grid=tuple((v,) for v in grid),
        lower=(-0.1,),
        upper=(0.1,),
        fixed=True,
    )
