"""Training samples: pairs of commanded and measured points with what was known at each."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrator.models.base import CalibrationModel
from calibrator.models.encoding import from_json, to_json
from calibrator.thermal import DERIVATIVE_SPAN
from stage_core.arrays import Array
from stage_core.errors import StageError


@dataclass(frozen=True)
class Samples:
    """Pairs of commanded and measured points.

    Attributes
    ----------
    command, measured, direction
        (n, axes): [m], [m] and the sign of each axis' last move.
    temperatures
        (n, sensors) [degC]; no columns where the session has no sensor.
    times
        (n,) seconds since the session's start.
    sensors, axes
        Names of the columns.
    shift
        By how much the measured stamps were late [s], estimated.
    at_rest
        Whether the samples are means over rests, or points of a moving stage.
    rates
        First [K/s] and second [K/s2] derivative of the temperatures, (n, 2, sensors); None where
        the session has no sensor or is too short for them.
    session
        (n,) which of several sessions a sample is of; None where there is one.
    """

    command: Array
    measured: Array
    direction: Array
    temperatures: Array
    times: Array
    sensors: tuple[str, ...]
    axes: tuple[str, ...]
    shift: float
    at_rest: bool
    rates: Array | None = None
    session: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.command)

    def holds(self, session: Samples) -> bool:
        """Whether the pairs of points of a session are all among these samples, to the bit."""
        own, other = (
            [row.tobytes() for row in np.hstack([part.command, part.measured])]
            for part in (self, session)
        )
        return set(other) <= set(own)

    def take(self, chosen: NDArray[np.int64] | NDArray[np.bool_]) -> Samples:
        """The samples of an index or mask."""
        return replace(
            self,
            command=self.command[chosen],
            measured=self.measured[chosen],
            direction=self.direction[chosen],
            temperatures=self.temperatures[chosen],
            times=self.times[chosen],
            rates=None if self.rates is None else self.rates[chosen],
            session=None if self.session is None else self.session[chosen],
        )

    def only(self, sensors: tuple[str, ...]) -> Samples:
        """The samples with these temperature sensors.

        Raises
        ------
        StageError
            If one is missing.
        """
        for sensor in sensors:
            if sensor not in self.sensors:
                raise StageError(
                    f'the session has no temperature sensor {sensor}, which the model was trained '
                    'with: record it, or train without temperatures'
                )
        chosen = [self.sensors.index(sensor) for sensor in sensors]
        return replace(
            self,
            temperatures=self.temperatures[:, chosen],
            sensors=tuple(sensors),
            rates=None if self.rates is None else self.rates[:, :, chosen],
        )

    @property
    def heat(self) -> Array | None:
        """Temperatures, or None without sensors."""
        return self.temperatures if self.temperatures.shape[1] else None

    def heat_for(self, model: CalibrationModel) -> Array | None:
        """Temperature columns as a model takes them: with the derivatives where it uses them.

        Raises
        ------
        StageError
            If the model uses derivatives and the samples have none.
        """
        if not model.uses_derivatives or self.heat is None:
            return self.heat
        if self.rates is None:
            raise StageError(
                f'the session is shorter than {DERIVATIVE_SPAN:.0f} s, too short for derivatives '
                'of temperatures: record longer or set the option derivatives to false'
            )
        return np.hstack([self.temperatures, self.rates[:, 0], self.rates[:, 1]])

    def to_dict(self) -> dict[str, Any]:
        """Everything as JSON can hold it; numbers keep every bit."""
        return {name: to_json(value) for name, value in vars(self).items()}

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Samples:
        """Inverse of `to_dict`."""
        fields = from_json(content)
        return cls(
            **{**fields, 'sensors': tuple(fields['sensors']), 'axes': tuple(fields['axes'])}
        )


@dataclass(frozen=True)
class Gathered:
    """Samples of all the data of a training together.

    Attributes
    ----------
    samples
        In the order of the bags.
    leads
        Lead of each axis' screw [m] from the first bag's nominal twin, None where it has none.
    bags
        Those that the samples came from.
    skipped
        Bags of a folder that gave none, each with the reason.
    """

    samples: Samples
    leads: list[float] | None = None
    bags: list[Path] = field(default_factory=list)
    skipped: dict[str, str] = field(default_factory=dict)


def concatenate(parts: list[Samples]) -> Samples:
    """Samples of several sessions together; sensors that all of them have are kept.

    Raises
    ------
    StageError
        If there is none or their axes differ.
    """
    if not parts:
        raise StageError('no training data: name at least one session bag')
    if len({part.axes for part in parts}) > 1:
        raise StageError('the sessions have different axes: train them apart')
    sensors = tuple(s for s in parts[0].sensors if all(s in part.sensors for part in parts))
    parts = [part.only(sensors) for part in parts]
    rates = [part.rates for part in parts if part.rates is not None]
    offsets = np.cumsum([0.0] + [float(p.times[-1]) + 1.0 for p in parts[:-1]])
    return Samples(
        np.vstack([p.command for p in parts]),
        np.vstack([p.measured for p in parts]),
        np.vstack([p.direction for p in parts]),
        np.vstack([p.temperatures for p in parts]),
        np.concatenate([p.times + o for p, o in zip(parts, offsets, strict=True)]),
        sensors,
        parts[0].axes,
        float(np.mean([p.shift for p in parts])),
        all(p.at_rest for p in parts),
        np.concatenate(rates) if len(rates) == len(parts) else None,
        np.repeat(np.arange(len(parts)), [len(p) for p in parts]) if len(parts) > 1 else None,
    )
