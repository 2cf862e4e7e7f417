"""The current loop lets the force rise with a time constant."""

from __future__ import annotations

import math

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.shared import filtered
from stage_twin.effects.term import Term, Theta

#: Drives lag in two stages: of eleven right ones of two simulators the middle one missed by 4 %,
#: the worst by 8 %.
DOUBT = 0.04

EFFECT = Effect(
    name='current_loop_lag',
    link='servo',
    parameters=(
        Parameter(
            'time_constant',
            's',
            0.0,
            0.02,
            1e-3,
            'time to 63 % of a step of the force',
            doubt=DOUBT,
        ),
    ),
    model='dF/dt = (command - F) / time_constant: a current loop of finite bandwidth. Leonhard, '
    '"Control of electrical drives" (2001), approximation of the current loop by a first-order '
    'lag.',
    sentence='the force follows its command with a time constant of {time_constant}',
    excited_by='a frequency sweep to 150 Hz',
    states=('force',),
    order=3,
    needs_effort="a lag of the force cannot be told from the controller's filter",
)


def drive(state: Array, force: float, step: float, time_constant: float) -> float:
    """Mean force over the step [N]: the lag of a held command, exact."""
    left = math.exp(-step / time_constant)
    missing = state[0] - force
    state[0] = force + missing * left
    return force + missing * (1.0 - left) * time_constant / step


def command(force: Array, step: float, time_constant: float) -> Array:
    """Force to command for a force that acts at the end of each tick, (n,) [N]."""
    left = math.exp(-step / time_constant)
    rise = np.diff(force, prepend=force[:1])
    return np.asarray(force + rise * left / (1.0 - left))


def lagged(force: Array, period: float, time_constant: float) -> Array:
    """Force (n,) [N] behind the lag, its mean over each tick in which the command is held."""
    left = math.exp(-period / time_constant) if time_constant > 0.0 else 0.0
    if left == 0.0:
        return force
    # Mean over a tick of the lag of a held value: weight of this tick's value and of the state.
    share = (1.0 - left) * time_constant / period
    state = filtered([1.0 - left], [1.0, -left], force, [left * force[0]])
    before = np.concatenate([force[:1], state[:-1]])
    return np.asarray(force + (before - force) * share)


def term(rows: ForceRows) -> Term:
    """The force less the same force behind the lag (θ)."""
    direct = rows.applied()

    def columns(theta: Theta) -> Array:
        pairs = zip(direct, rows.periods, strict=True)
        return rows.columns([f - lagged(f, period, theta[0]) for f, period in pairs])

    return Term(
        columns,
        lambda theta, c: {'time_constant': theta[0]},
        grid=tuple((t,) for t in (2e-4, 5e-4, 1e-3, 2e-3, 3e-3, 5e-3, 8e-3, 15e-3)),
        lower=(0.0,),
        upper=(0.02,),
        fixed=True,
    )
