"""Temperatures of a session, and their derivatives, at the times of its samples."""

from __future__ import annotations

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
