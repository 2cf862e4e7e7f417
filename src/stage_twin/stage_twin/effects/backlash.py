"""Play between motor and table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numba import njit

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import Signal, TrackerRows
from stage_twin.effects.term import Term, Theta

#: Of five right widths of foreign simulators, whose edges are soft, one missed by 2.3 %, two by
#: 0.9 %.
DOUBT = 0.01

EFFECT = Effect(
    name='backlash',
    link='kinematic',
    parameters=(Parameter('width', 'm', 0.0, 1e-3, 10e-6, 'full width of the play', doubt=DOUBT),),
    model='Play operator between motor and table, centred at the start of a session. Nordin and '
    'Gutman, "Controlling mechanical systems with backlash: a survey", Automatica 38 (2002).',
    sentence='the table follows the motor late by {width} after each reversal',
    states=('position',),
    reverses=True,
    excited_by='the same positions approached from both sides',
)


def start(state: Array, position: float) -> None:
    """The table in the middle of the play."""
    state[0] = position


def follow(state: Array, position: float, width: float) -> float:
    """Position behind the play [m]."""
    half = 0.5 * width
    state[0] = min(max(state[0], position - half), position + half)
    return state[0]


@njit(cache=True)
def slack(position: Array, width: float) -> Array:
    """Output of the play operator minus its input, shape (n,) [m]; centred at the start."""
    out = np.empty(len(position))
    half = 0.5 * width
    follower = position[0]
    for k in range(len(position)):
        if position[k] - follower > half:
            follower = position[k] - half
        elif follower - position[k] > half:
            follower = position[k] + half
        out[k] = follower - position[k]
    return out


def term(rows: TrackerRows) -> Term:
    """What a play of some width (θ) leaves behind.

    The plain path of a noisy encoder is smoothed until its noise turns it no more, which cuts
    quick turns off. The richer shape follows the motion up to 90 Hz, where held-out points say
    that this is better.
    """
    plain = _term(rows, rows.encoder())
    return plain if rows.rests else replace(plain, richer=lambda: _term(rows, rows.calm_encoder()))


def _term(rows: TrackerRows, paths: Signal) -> Term:
    """A play behind some paths of the axis."""

    def columns(theta: Theta) -> Array:
        return rows.along(rows.at_points([slack(q, theta[0]) for q in paths]))

    return Term(
        columns,
        lambda theta, c: {'width': theta[0]},
        grid=tuple((w,) for w in np.geomspace(0.5e-6, 300e-6, 22)),
        lower=(0.0,),
        upper=(1.0e-3,),
        fixed=True,
    )
