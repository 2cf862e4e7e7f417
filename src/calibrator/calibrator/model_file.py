"""Versioned model files: JSON with a checksum, replaced atomically, refused when in doubt."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from calibrator.models import model_from_dict
from calibrator.models.base import CalibrationModel
from calibrator.models.encoding import to_json
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.metrics import SIGMAS
from stage_core.quantities import AXES
from stage_core.untrusted import file_text, json_object
from stage_core.whole_file import write_whole
from stage_core.wording import span

FORMAT = 'stage-calibration-model'
FORMAT_VERSION = 1

LAG = 'it learned a moving stage, whose error is the lag of its servo: train one at rest'


@dataclass(frozen=True)
class StoredModel:
    """A model with where it came from.

    Attributes
    ----------
    model
        The fitted model.
    machine
        Name of the stage that it was trained for; empty where it does not matter.
    version
        Counts the trainings on this machine, from 1.
    training
        Names and sha256 of the training bags.
    metrics
        Errors before and after on held-out data [m].
    seed
        Seed of everything random in the training.
    sensors
        Names of the temperature columns.
    """

    model: CalibrationModel
    machine: str = ''
    version: int = 1
    training: dict[str, str] = field(default_factory=dict)
    metrics: dict[str, Any] = field(default_factory=dict)
    seed: int = 0
    sensors: tuple[str, ...] = ()

    @property
    def refusal(self) -> str:
        """Why the model must not correct: it was written by force, or of a motion; else empty."""
        reason = str(self.metrics.get('refusal', ''))
        return reason or (LAG if self.fastest else '')

    @property
    def fastest(self) -> float:
        """Speed [m/s] up to which a moving stage was learned; zero for one at rest."""
        return float(self.metrics.get('domain', {}).get('speeds', (0.0, 0.0))[1])

    @property
    def drift(self) -> str:
        """Why a drift may be part of the model; empty where it was told apart or is not known."""
        return str(self.metrics.get('drift', ''))

    def temperature_row(
        self,
        readings: Mapping[str, float],
        rates: Mapping[str, tuple[float, float]],
    ) -> Array | None:
        """Temperatures of one point as `invert` takes them, (1, columns); None without sensors.

        Readings [degC] and their derivatives [K/s], [K/s2] by sensor; what is not given is the
        mean of the training.
        """
        if not self.sensors:
            return None
        usual = self.model.mean_temperatures.reshape(-1, len(self.sensors))
        row = [readings.get(sensor, usual[0, k]) for k, sensor in enumerate(self.sensors)]
        for order in range(1, len(usual)):
            row += [
                rates[sensor][order - 1] if sensor in rates else usual[order, k]
                for k, sensor in enumerate(self.sensors)
            ]
        return np.array([row])

    def invert(
        self,
        target: ArrayLike,
        direction: ArrayLike | None = None,
        temperatures: ArrayLike | None = None,
        largest: float = math.inf,
    ) -> Array:
        """Commands that reach table points, (n, axes) [m]; see `CalibrationModel.invert`.

        Raises
        ------
        StageError
            If a point cannot be inverted, or a correction exceeds `largest` [m]: the stage must
            not go there.
        """
        wanted = np.asarray(target)
        commands = self.model.invert(wanted, direction, temperatures)
        most = np.max(np.abs(commands - wanted), axis=1)
        if (most > largest).any():
            worst = int(np.argmax(most))
            raise StageError(
                f'the correction at {wanted[worst].tolist()} m is {1e6 * most[worst]:.1f} µm, '
                f'beyond max_correction {1e6 * largest:.1f} µm of the calibrator: retrain, or '
                'raise max_correction'
            )
        return commands

    def domain_line(self) -> str:
        """Where the model was trained, for a person, with how wide its intervals are there."""
        seen = self.model.domain
        assert seen is not None
        heat = len(self.sensors)
        parts = [
            f'{axis} {span(1e3 * low, 1e3 * high, "mm", 1)}'
            for axis, low, high in zip(AXES, seen.low, seen.high, strict=False)
        ]
        parts += [
            f'{sensor} {span(low, high, "°C", 2)}'
            for sensor, low, high in zip(
                self.sensors, seen.coldest[:heat], seen.hottest[:heat], strict=True
            )
        ]
        parts.append(f'up to {1e3 * self.fastest:.0f} mm/s' if self.fastest else 'at rest')
        half = ', '.join(
            f'{axis} ± {1e6 * SIGMAS * deviation:.2f} µm'
            for axis, deviation in zip(AXES, self.model.spread, strict=False)
        )
        count = self.metrics.get('sessions', 1)
        judged = (
            f'judged by {count} sessions' if count > 1 else 'while the stage stays as it was then'
        )
        return (
            f'{", ".join(parts)}; beyond it the model holds its edge; 95 % of predictions are '
            f'right within {half}, {judged}'
        )

    def beyond(self, command: Array, temperatures: Array | None) -> str:
        """Why the model does not know these points (n, axes) [m]; empty inside its domain."""
        assert self.model.domain is not None
        heat = self.model.mean_temperatures[None] if temperatures is None else temperatures
        return self.model.domain.beyond(command, heat)


def save(stored: StoredModel, path: str | Path) -> None:
    """Write a model; a reader sees the old file or the new one, never a part of either.

    Raises
    ------
    StageError
        If the folder cannot be written or the model holds a number that JSON cannot.
    """
    target = Path(path)
    content = {
        'machine': stored.machine,
        'version': stored.version,
        'training': stored.training,
        'metrics': stored.metrics,
        'seed': stored.seed,
        'sensors': list(stored.sensors),
        'model': stored.model.to_dict(),
    }
    try:
        body = _canonical(to_json(content))
    except ValueError as error:
        raise StageError(
            f'the {stored.model.method} model holds a number that is not finite: train it again'
        ) from error
    text = json.dumps(
        {
            'format': FORMAT,
            'format_version': FORMAT_VERSION,
            'sha256': hashlib.sha256(body.encode()).hexdigest(),
            'content': json.loads(body),
        }
    )
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        write_whole(target, text)
    except OSError as error:
        raise StageError(
            f'{target} cannot be written ({error.strerror}): choose another folder'
        ) from error


def load(path: str | Path, machine: str = '') -> StoredModel:
    """Read a model file.

    Parameters
    ----------
    path
        The file.
    machine
        Name of the stage at hand; a model of another one is refused. Empty accepts any.

    Raises
    ------
    StageError
        If the file is absent, truncated, altered, of another format version or machine, or holds a
        model that cannot predict.
    """
    source = Path(path)
    what, remedy = f'the model file {source}', 'train the model again, or name another file'
    document = json_object(file_text(source, what, remedy), what, remedy)
    if document.get('format') != FORMAT:
        raise StageError(f'{source} is no calibration model: choose a file that retraining wrote')
    if document.get('format_version') != FORMAT_VERSION:
        raise StageError(
            f'{source} has format version {document.get("format_version")}, this software reads '
            f'{FORMAT_VERSION}: train the model again from its bag'
        )
    content = document.get('content')
    if not isinstance(content, dict):
        raise StageError(f'{source} holds no model: train it again')
    try:
        body = _canonical(content)
    except ValueError:
        body = ''  # a number that is not finite, which `save` never writes
    if hashlib.sha256(body.encode()).hexdigest() != document.get('sha256'):
        raise StageError(
            f'{source} was altered after it was written (checksum differs): train the model again'
        )
    owner = content.get('machine')
    if machine and owner and owner != machine:
        raise StageError(
            f'{source} was trained on machine {owner}, this one is {machine}: '
            'train a model for this machine'
        )
    try:
        return _stored(content)
    except StageError as error:
        reason = str(error)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        reason = repr(error)
    raise StageError(
        f'{source} is of other software or incomplete ({reason}): train the model again from its '
        'bag'
    )


def _stored(content: dict[str, Any]) -> StoredModel:
    """The model of a file's content, once it has predicted at the places that it knows."""
    stored = StoredModel(
        model_from_dict(content['model']),
        content['machine'],
        int(content['version']),
        content['training'],
        content['metrics'],
        int(content['seed']),
        tuple(content['sensors']),
    )
    domain, heat = stored.model.domain, stored.temperature_row({}, {})
    assert domain is not None
    places = domain.places
    row = None if heat is None else np.tile(heat, (len(places), 1))
    if not np.isfinite(stored.model.predict(places, np.ones_like(places), row, warn=False)).all():
        raise ValueError('a prediction is not finite')
    return stored


def bag_hash(path: str | Path) -> str:
    """The sha256 over the .mcap files of a bag (a directory or one file), in name order."""
    source = Path(path)
    files = sorted(source.rglob('*.mcap')) if source.is_dir() else [source]
    digest = hashlib.sha256()
    for file in files:
        with file.open('rb') as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


def _canonical(content: dict[str, Any]) -> str:
    return json.dumps(content, sort_keys=True, allow_nan=False, separators=(',', ':'))
