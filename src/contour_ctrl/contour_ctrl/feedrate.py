"""Jerk-limited feed along the arc, and the limits that each axis sets to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.quantities import AXES


@dataclass(frozen=True)
class AxisLimits:
    """What each axis (x, y) can do: speed [m/s], acceleration [m/s^2], jerk [m/s^3]."""

    speed: tuple[float, float] = (0.5, 0.5)
    acceleration: tuple[float, float] = (10.0, 10.0)
    jerk: tuple[float, float] = (2000.0, 2000.0)

    def __post_init__(self) -> None:
        for name in ('speed', 'acceleration', 'jerk'):
            values = getattr(self, name)
            if not all(np.isfinite(value) and value > 0.0 for value in values):
                raise StageError(f'the axis limit of {name} must be positive, not {values}')

    def excess(self, velocity: Array, acceleration: Array, jerk: Array) -> tuple[float, str, int]:
        """Return the largest ratio of need to limit, the limit's name, and its tick."""
        worst, name, tick = 0.0, '', 0
        for quantity, unit, values, limits in (
            ('speed', 'm/s', velocity, self.speed),
            ('acceleration', 'm/s^2', acceleration, self.acceleration),
            ('jerk', 'm/s^3', jerk, self.jerk),
        ):
            for axis in range(2):
                index = int(np.argmax(np.abs(values[:, axis])))
                need = float(abs(values[index, axis]))
                if need / limits[axis] > worst:
                    worst, tick = need / limits[axis], index
                    name = (
                        f'{quantity} limit of axis {AXES[axis]} '
                        f'({limits[axis]:g} {unit}, {need:.4g} needed)'
                    )
        return worst, name, tick


@dataclass(frozen=True)
class SCurve:
    """Seven-segment motion from rest to rest: length [m], feed, jerk.

    `feed` is the one that is reached: lower than the wanted one where the way is short.
    Segments: jerk, constant acceleration, jerk; cruise; and the same mirrored.
    """

    length: float
    feed: float
    jerk: float
    durations: Array

    @staticmethod
    def plan(length: float, feed: float, acceleration: float, jerk: float) -> SCurve:
        """Return the fastest such motion within the limits given.

        With t_j = a/j the ramp to v takes v/a + t_j where v j >= a^2 and 2 sqrt(v/j) otherwise;
        either way it covers v/2 times its duration.
        """
        for name, value in (('length', length), ('feed', feed)):
            if not (np.isfinite(value) and value > 0.0):
                raise StageError(f'the {name} of a motion must be positive, not {value}')
        if not (acceleration > 0.0 and jerk > 0.0):
            raise StageError('acceleration and jerk of the feed must be positive')
        top = min(feed, (0.5 * length * np.sqrt(jerk)) ** (2.0 / 3.0))
        if top * jerk > acceleration**2:
            ramp = acceleration / jerk
            top = 0.5 * acceleration * (-ramp + np.sqrt(ramp**2 + 4.0 * length / acceleration))
            top = min(feed, float(top))
        peak = min(acceleration, float(np.sqrt(top * jerk)))
        rise = peak / jerk
        hold = max(top / peak - rise, 0.0)
        cruise = max(length / top - (2.0 * rise + hold), 0.0)
        durations = np.array([rise, hold, rise, cruise, rise, hold, rise])
        return SCurve(length, float(top), jerk, durations)

    @property
    def duration(self) -> float:
        """Total time [s]."""
        return float(self.durations.sum())

    def at(self, time: ArrayLike) -> tuple[Array, Array, Array]:
        """Return arc [m], feed [m/s] and tangential acceleration [m/s^2] at times (n,) [s]."""
        t = np.clip(np.atleast_1d(np.asarray(time, dtype=float)), 0.0, self.duration)
        signs = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0]) * self.jerk
        starts = np.concatenate([[0.0], np.cumsum(self.durations)])
        state = np.zeros((8, 3))
        for i in range(7):
            state[i + 1] = _integrate(state[i], signs[i], self.durations[i])
        segment = np.clip(np.searchsorted(starts, t, side='right') - 1, 0, 6)
        arc, feed, acceleration = _integrate(state[segment].T, signs[segment], t - starts[segment])
        return np.clip(arc, 0.0, self.length), np.maximum(feed, 0.0), acceleration


def _integrate(state: Array, jerk: Array, time: Array) -> Array:
    """Advance (position, speed, acceleration) by a constant jerk for `time`."""
    position, speed, acceleration = state
    return np.stack(
        [
            position + time * (speed + time * (0.5 * acceleration + time * jerk / 6.0)),
            speed + time * (acceleration + 0.5 * time * jerk),
            acceleration + time * jerk,
        ]
    )
