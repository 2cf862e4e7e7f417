"""Where an axis slides behind a friction that its twin states.

No two models of a friction agree within its presliding. Behind a friction that a twin states, the
machine has another one: after each reversal and at each rest the twin goes another way, which
says nothing of what it lacks. Such an axis counts where it slides.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.closed_loop.dither import sticks
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import judging, scored_ticks
from stage_core.quantities import split_effect
from stage_core.twin_file import ServoAxis, TwinFile

#: Time for which a reference moves one way, at more than a share of its top speed, until an axis
#: counts as sliding: as many time constants of its loop. Of the gap that another presliding makes
#: after a reversal 1 to 2 % was left then, in ten loops of 0.02 to 0.2 s.
SLIDES, SLOW = 6.0, 0.02
#: Share of the ticks from which on the gap is told where an axis slides.
ENOUGH = 0.05


def slides(records: Sequence[Record], twin: TwinFile, axis: str) -> bool:
    """Whether an axis with a friction that the twin states slides long enough to be told by it."""
    stated = [n for n in twin.effects if split_effect(n)[1] == axis]
    if twin.kind != 'servo' or not sticks(stated):
        return False
    rows = [sliding(r, twin, axis)[scored_ticks(r)] for r in judging(records)]
    return float(np.mean(np.concatenate(rows))) > ENOUGH


def sliding(record: Record, twin: TwinFile, axis: str) -> NDArray[np.bool_]:
    """Ticks (n,) at which the reference has moved one way for `SLIDES`."""
    speed = np.nan_to_num(record.reference_velocity[:, record.column(axis)])
    way = np.sign(speed) * (np.abs(speed) > SLOW * np.abs(speed).max(initial=0.0))
    turns = np.flatnonzero(np.diff(way, prepend=0.0))
    began = np.concatenate([[0], turns])[np.searchsorted(turns, np.arange(len(way)), 'right')]
    since = record.time - record.time[began]
    return (way != 0.0) & (since > SLIDES * settling_time(twin.servo(axis)))


def settling_time(axis: ServoAxis) -> float:
    """Time constant [s] of the slowest decay of the loop, its filter and its delay left out.

    Of the mass with its viscous force behind the gains of interfaces.md, "Servo control law".
    """
    gain, slope = axis.velocity_gain, axis.integral_gain
    place = axis.position_gain
    poles = np.roots([axis.mass, axis.viscous + gain, gain * place + slope, slope * place])
    decays = -poles.real[poles.real < 0.0]  # without an integral gain its state stays
    return float(1.0 / decays.min())
