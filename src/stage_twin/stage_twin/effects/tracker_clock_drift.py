"""A clock of the tracker that runs fast or slow."""

from __future__ import annotations

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.lateness import lateness
from stage_twin.effects.rows import TrackerRows
from stage_twin.effects.term import Term

#: Of five right drifts of foreign simulators one missed by 0.4 %, the others by 0.1 % at most.
DOUBT = 0.003

EFFECT = Effect(
    name='tracker_clock_drift',
    link='sensor',
    parameters=(
        Parameter('drift', 's/s', -1e-3, 1e-3, 20e-6, 'stamp = t * (1 + drift)', doubt=DOUBT),
    ),
    model="The tracker's quartz runs fast or slow; zero at the session's start. Mills, "
    '"Computer network time synchronization" (2011), clock frequency error.',
    sentence='the tracker clock runs fast by {drift}',
    excited_by='the same fast stroke at the beginning and at the end of a session of 10 minutes',
    per_axis=False,
    seen_by_encoder=False,
)


def stamp(times: Array, drift: float) -> Array:
    """Stamps of the tracker's clock at some times [s]."""
    return times * (1.0 + drift)


def true_time(stamps: Array, drift: float) -> Array:
    """Time [s] at which the table was where points of these stamps show it."""
    return stamps / (1.0 + drift)


signature = lateness


def term(rows: TrackerRows) -> Term | None:
    """Where the table was by a clock that runs fast (θ), less where it is."""
    if rows.rests:
        return None
    known = sum(frame.drift for frame in rows.frames)
    grid = [s * v for v in np.geomspace(2e-6, 1e-3, 12) for s in (1.0, -1.0)]
    return Term(
        lambda theta: rows.shifted(drift=theta[0]),
        lambda theta, c: {'drift': known + theta[0]},
        grid=tuple((v,) for v in grid),
        lower=(-1e-3,),
        upper=(1e-3,),
        fixed=True,
    )
