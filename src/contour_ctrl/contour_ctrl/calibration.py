"""The active calibration as a contour takes it: its inverse at the temperatures of now."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from calibrator.model_file import StoredModel, load
from stage_core import topics
from stage_core.arrays import Array
from stage_core.errors import StageError

#: What has to stand in the announcement of an active model, and as what.
ANNOUNCED: dict[str, type | tuple[type, ...]] = {
    'file': str,
    'version': int,
    'metrics': Mapping,
    'max_correction': (int, float),
}


def announced_model(announced: Mapping[str, Any]) -> StoredModel:
    """The model that the calibrator announced as active.

    Raises
    ------
    StageError
        If it lacks a key or holds another type there, names no file or one that cannot be read,
        or one that holds another model by now or one that must not correct.
    """
    lacking = [
        name
        for name, kind in ANNOUNCED.items()
        if not isinstance(announced.get(name), kind) or announced[name] == ''
    ]
    if lacking:
        raise StageError(
            f'{topics.MODEL} is active without {" and ".join(lacking)}: retrain the calibrator'
        )
    path = announced['file']
    stored = load(path)
    if announced['version'] != stored.version or announced['metrics'] != stored.metrics:
        raise StageError(
            f'{path} is no longer the model that the calibrator corrects with: call '
            '/calibrator/load to take it, or /calibrator/retrain'
        )
    if stored.refusal:
        raise StageError(f'{path} must not correct: {stored.refusal}')
    return stored


def inverse(
    stored: StoredModel,
    readings: Mapping[str, float],
    rates: Mapping[str, tuple[float, float]],
    largest: float,
) -> Callable[[Array], Array]:
    """Map of wanted table points (n, 2) [m] to commands; the temperatures hold for all of them.

    Of a sensor that is not among the readings [degC] the mean of the training stands in. The map
    raises a StageError where it corrects by more than `largest` [m].
    """
    row = stored.temperature_row(readings, rates)

    def commands(points: Array) -> Array:
        heat = None if row is None else np.tile(row, (len(points), 1))
        return stored.invert(points, None, heat, largest)

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
