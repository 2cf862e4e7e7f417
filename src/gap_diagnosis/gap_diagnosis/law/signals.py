"""The variables of a law at the rows of a residual, and the columns that shapes of them make."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from gap_diagnosis.input.checks import reverses
from gap_diagnosis.residuals.force_rows import ForceRows
from gap_diagnosis.residuals.kinematics import Kinematics
from gap_diagnosis.residuals.low_pass import smooth
from gap_diagnosis.residuals.operators import central_difference
from stage_core.arrays import Array
from stage_twin.effects import law_terms
from stage_twin.effects.backlash import slack
from stage_twin.effects.friction import presliding_state
from stage_twin.effects.shared import filtered

Signal = list[Array]

PATH = 60.0  # Hz, low-pass of the velocity that stands in a nonlinear function


@njit(cache=True)
def shaped(x: Array, shape: int, scale: float, bend: float) -> Array:
    """A shape of `law_terms.factor` at many values (n,)."""
    out = np.empty(len(x))
    for k in range(len(x)):
        out[k] = law_terms.factor(x[k], shape, scale, bend)
    return out


def remembered(signal: Array, memory: float, period: float) -> Array:
    """A signal (n,) as `law_terms.remembered` makes it tick by tick."""
    if memory == 0.0:
        return signal
    left = math.exp(-period / abs(memory))
    behind = filtered([1.0 - left], [1.0, -left], signal)
    return behind if memory > 0.0 else signal - behind


@dataclass(frozen=True)
class Signals:
    """Variables of a law at every tick of each session, and how they become rows.

    Attributes
    ----------
    ticks : name of a variable -> its signal, one array per session
    columns : signals -> their columns (n, k) at the rows
    used : signal -> its values (n,) at the rows, as they are
    direction : reach [m] -> the signal of the direction of the motion, -1 to 1, of an error the
        side in a play so wide; None on an axis that never turns back
    unit : of the target
    """

    ticks: dict[str, Signal]
    columns: Callable[..., Array]
    used: Callable[[Signal], Array]
    periods: list[float]
    direction: Callable[[float], Signal] | None
    unit: str
    lead: float

    def range(self, name: str) -> tuple[float, float]:
        """Least and largest value of a variable at the rows."""
        if name == 's':
            return -1.0, 1.0
        values = self.used(self.ticks[name])
        return float(values.min()), float(values.max())

    def scale(self, name: str) -> float:
        """Largest magnitude of a variable at the rows, rounded to one digit."""
        if name == 's':
            return 1.0
        return float(f'{max(np.abs(self.range(name))) or 1.0:.0e}')


def force_signals(rows: ForceRows) -> Signals:
    """Variables of the force on the moving mass of an axis [N]."""
    ticks = {
        'p': rows.position(),
        'v': rows.smooth_velocity(),
        'a': rows.acceleration(),
        'F': rows.applied(),
        't': [r.time for r in rows.records],
    }
    velocity, acceleration = rows.other_velocity(), rows.other_acceleration()
    if velocity is not None and acceleration is not None:
        ticks['u'] = [
            smooth(u, r.period, PATH) for u, r in zip(velocity, rows.records, strict=True)
        ]
        ticks['w'] = acceleration
    turns = any(reverses(r, r.column(rows.axis)) for r in rows.records)

    def direction(reach: float) -> Signal:
        return [presliding_state(p, reach) for p in rows.position()]

    return Signals(
        ticks, rows.columns, rows.used, rows.periods, direction if turns else None, 'N', rows.lead
    )


def error_signals(rows: Kinematics, axis: str) -> Signals:
    """Variables of the error of the table along an axis [m], at the tracker's points."""
    own = rows.of(axis)
    i = own.axes.index(axis)
    path = own.path()
    ticks = {
        'p': path,
        'v': [
            central_difference(smooth(q, r.period, PATH), r.period)
            for q, r in zip(path, own.records, strict=True)
        ],
        't': [r.time for r in own.records],
    }
    if len(own.axes) == 2 and any(r.moving[1 - i] for r in own.records):
        ticks['q'] = [r.encoder[:, 1 - i] for r in own.records]
    if own.temperature_rise() is not None:
        reference = own.twin.temperature_reference
        ticks['T'] = [
            r.temperature[:, i] - reference for r in own.records if r.temperature is not None
        ]
    turns = any(reverses(r, i) for r in own.records)

    def used(signal: Signal) -> Array:
        return np.concatenate(own.at_points(signal))

    def columns(*signals: Signal) -> Array:
        return np.column_stack([used(signal) for signal in signals])

    def direction(reach: float) -> Signal:
        return [-2.0 / reach * slack(q, reach) for q in path]

    periods = [r.period for r in own.records]
    return Signals(ticks, columns, used, periods, direction if turns else None, 'm', own.lead)
