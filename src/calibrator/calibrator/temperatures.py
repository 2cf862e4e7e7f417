"""Temperatures of a session at the times of its samples, and of a running stage by now."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from calibrator.ring import Ring
from calibrator.thermal import DERIVATIVE_SPAN, derivatives_at
from stage_core import topics
from stage_core.arrays import Array
from stage_core.clocks import to_seconds
from stage_core.errors import StageError
from stage_core.session import Series, Session

Rates = tuple[float, float]
"""First and second derivative of a temperature [K/s], [K/s2]."""

STALE = 60.0
"""A temperature older than this [s] is a sensor that dropped out."""
MOST_READINGS = 20_000
"""Readings kept of each sensor."""
MOST_SENSORS = 64
"""Names come from the graph: made up ones must not fill the memory."""


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
    """What a running stage's sensors said of late, in rings of fixed size."""

    def __init__(self, capacity: int = MOST_READINGS) -> None:
        self._capacity = min(capacity, MOST_READINGS)
        self._rings: dict[str, Ring] = {}
        self._newest: dict[str, tuple[int, float]] = {}
        self._rates: dict[str, Rates | None] = {}

    def hear(self, sensor: str, value: float, stamp: int, now: int) -> None:
        """Take a reading [degC] stamped `stamp`, at `now` [ns].

        One that is no number counts as none. Of more than `MOST_SENSORS` the first ones are kept.
        """
        if sensor not in self._rings:
            if len(self._rings) >= MOST_SENSORS:
                return
            self._rings[sensor] = Ring(self._capacity, 1)
        self._rings[sensor].add(stamp, (value,))
        self._rates.pop(sensor, None)
        if math.isfinite(value):
            self._newest[sensor] = now, value

    def fresh(self, now: int, timeout: float = STALE) -> dict[str, float]:
        """Readings [degC] by sensor of those heard within `timeout` [s].

        What was heard before a clock that was set back is of a time that is not known.
        """
        return {
            sensor: value
            for sensor, (heard, value) in self._newest.items()
            if 0.0 <= 1e-9 * (now - heard) <= timeout
        }

    def rates(self, sensors: Iterable[str]) -> dict[str, Rates]:
        """Derivatives at the newest reading, of the sensors of which enough was heard."""
        found = {}
        for sensor in sensors:
            if sensor in self._rings and sensor not in self._rates:
                self._rates[sensor] = _newest_rates(self._rings[sensor])
            rates = self._rates.get(sensor)
            if rates is not None:
                found[sensor] = rates
        return found

    def series(
        self, newest: int | None = None, sensors: Iterable[str] | None = None
    ) -> dict[str, Series]:
        """The `newest` readings of these sensors as series of a session; None stands for all."""
        result = {}
        for sensor in self._rings if sensors is None else sensors:
            if sensor in self._rings:
                key = topics.temperature_key(sensor)
                stamps, rows = self._rings[sensor].content(newest)
                result[key] = Series(key, stamps, {'temperature': rows[:, 0]})
        return result


def _newest_rates(ring: Ring) -> Rates | None:
    stamps, rows = ring.content()
    known = np.isfinite(rows[:, 0])
    times = 1e-9 * (stamps[known] - stamps[-1])
    recent = times >= -2.0 * DERIVATIVE_SPAN
    try:
        first, second = derivatives_at(times[recent], rows[known, 0][recent], np.zeros(1))
    except StageError:
        return None
    return float(first[0]), float(second[0])


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
