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

#: An axis slides from so many time constants of its loop on after it has left the place where its
#: reference turned, by so many of the stated preslidings, while that moves at more than a share of
#: its top speed. On 42 axes of a foreign simulator whose twins state a friction and lack nothing
#: the gap was up to 67 floors before, up to 2.6 from four to six time constants on, and up to 1.8
#: later. By the time since the turn alone it was up to 40 floors in the same.
SETTLED, LEFT_BEHIND, SLOW = 6.0, 3.0, 0.02
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
    """Ticks (n,) at which an axis slides behind the frictions that its twin states."""
    column, ticks = record.column(axis), np.arange(len(record.time))
    speed = np.nan_to_num(record.reference_velocity[:, column])
    way = np.sign(speed) * (np.abs(speed) > SLOW * np.abs(speed).max(initial=0.0))
    turns = np.append(0, np.flatnonzero(np.diff(way, prepend=0.0)))
    turned = turns[np.searchsorted(turns[1:], ticks, 'right')]
    place = record.encoder[:, column]
    there = (place - place[turned]) * way < LEFT_BEHIND * _presliding(twin, axis)
    began = np.maximum(turned, np.maximum.accumulate(np.where(there, ticks, 0)))
    since = record.time - record.time[began]
    return (way != 0.0) & (since > SETTLED * settling_time(twin.servo(axis)))


def _presliding(twin: TwinFile, axis: str) -> float:
    """The longest presliding [m] that a twin states for an axis; at least its encoder's step."""
    stated = [
        v.get('presliding', 0.0) for n, v in twin.effects.items() if split_effect(n)[1] == axis
    ]
    return max([*stated, twin.servo(axis).encoder_resolution])


def settling_time(axis: ServoAxis) -> float:
    """Time constant [s] of the slowest decay of the loop, its filter and its delay left out.

    Of the mass with its viscous force behind the gains of interfaces.md, "Servo controller".
    """
    gain, slope = axis.velocity_gain, axis.integral_gain
    place = axis.position_gain
    poles = np.roots([axis.mass, axis.viscous + gain, gain * place + slope, slope * place])
    decays = -poles.real[poles.real < 0.0]  # without an integral gain its state stays
    return float(1.0 / decays.min())
