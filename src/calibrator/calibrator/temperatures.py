"""Temperatures of a session at the times of its samples, and of a running stage by now."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from calibrator.thermal import derivatives_at
from stage_core.clocks import to_seconds
from stage_core.errors import StageError
from stage_core.session import Session

Array = NDArray[np.float64]

STALE = 60.0
"""A temperature older than this [s] is a sensor that dropped out."""


def readings_at(session: Session, at: Array) -> tuple[tuple[str, ...], Array]:
    """Names of the sensors and their readings [degC] at the times `at` [s], (n, sensors).

    Raises
    ------
    StageError
        If a sensor was silent or gave no number for more than `STALE`.
    """
    series = session.temperatures()
    columns = []
    for name, sensor in series.items():
        values = sensor.values['temperature']
        times = to_seconds(sensor.stamps, session.start_ns)
        times, values = times[np.isfinite(values)], values[np.isfinite(values)]
        after = np.searchsorted(times, at)
        near = [np.clip(after + side, 0, len(times) - 1) for side in (-1, 0)]
        if not len(times) or np.min([np.abs(at - times[i]) for i in near], axis=0).max() > STALE:
            raise StageError(
                f'{session.path}: temperature sensor {name} dropped out for more than '
                f'{STALE:.0f} s: repair the sensor or leave its topic out'
            )
        columns.append(np.interp(at, times, values))
    return tuple(series), np.column_stack(columns) if columns else np.empty((len(at), 0))


def rates_at(session: Session, at: Array) -> Array | None:
    """Derivatives (n, 2, sensors) of all sensors, None where the session is too short."""
    columns = []
    for sensor in session.temperatures().values():
        values = sensor.values['temperature']
        times, known = to_seconds(sensor.stamps, session.start_ns), np.isfinite(values)
        try:
            columns.append(np.stack(derivatives_at(times[known], values[known], at), axis=1))
        except StageError:
            return None
    return np.stack(columns, axis=2)


class LiveTemperatures:
    """The newest reading [degC] of each sensor of a running stage, and when it was heard."""

    def __init__(self) -> None:
        self._newest: dict[str, tuple[int, float]] = {}

    def hear(self, sensor: str, value: float, now: int) -> None:
        """Take a reading at `now` [ns]; one that is no number counts as none."""
        if math.isfinite(value):
            self._newest[sensor] = now, value

    def fresh(self, now: int, timeout: float) -> dict[str, float]:
        """Readings by sensor of those heard within `timeout` [s]."""
        return {
            sensor: value
            for sensor, (heard, value) in self._newest.items()
            if 1e-9 * (now - heard) <= timeout
        }


def silence(wanted: Iterable[str], fresh: Iterable[str]) -> str:
    """Line on the wanted sensors that have no fresh reading; empty where all have one."""
    silent = ', '.join(sorted(set(wanted) - set(fresh)))
    if not silent:
        return ''
    return (
        f'temperature sensor {silent} is silent, and the model in use corrects by it: targets are '
        'ignored until it is heard; repair it, load a model without it, or switch the correction '
        'off with ~/activate'
    )
