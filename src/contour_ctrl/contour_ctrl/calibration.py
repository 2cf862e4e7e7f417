"""The active calibration as a contour takes it: its inverse at the temperatures of now."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from calibrator.model_file import StoredModel

FloatArray = NDArray[np.float64]


def inverse(
    stored: StoredModel,
    readings: Mapping[str, float],
    rates: Mapping[str, tuple[float, float]],
) -> Callable[[FloatArray], FloatArray]:
    """Map of wanted table points (n, 2) [m] to commands; the temperatures hold for all of them.

    Of a sensor that is not among the readings [degC] the mean of the training stands in.
    """
    row = stored.temperature_row(readings, rates)

    def commands(points: FloatArray) -> FloatArray:
        heat = None if row is None else np.tile(row, (len(points), 1))
        return stored.invert(points, None, heat)

    return commands


def temperatures_line(stored: StoredModel, readings: Mapping[str, float]) -> str:
    """What the contour is planned for, of a model that corrects by temperature."""
    row = stored.temperature_row(readings, {})
    assert row is not None
    degrees = dict(zip(stored.sensors, row[0], strict=False))

    def named(sensors: list[str]) -> str:
        return ', '.join(f'{sensor} {degrees[sensor]:.2f} °C' for sensor in sensors)

    heard = [sensor for sensor in stored.sensors if sensor in readings]
    silent = [sensor for sensor in stored.sensors if sensor not in readings]
    parts = [f'heard now: {named(heard)}'] if heard else []
    if silent:
        parts.append(f'not heard, so the mean of the training: {named(silent)}')
    return f'the contour is planned for temperatures {"; ".join(parts)}'
