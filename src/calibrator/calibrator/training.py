"""Training a method on samples, with its errors on held-out positions."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrator.model_file import StoredModel, bag_hash
from calibrator.models import METHODS, make_model
from calibrator.models.base import CalibrationModel
from calibrator.models.structured import Structured
from calibrator.prepare import Samples, split
from stage_core.session import Session

Array = NDArray[np.float64]

LEAST_WARMING = 0.3
"""Change of a sensor [K] from which its temperature is a regressor."""


@dataclass(frozen=True)
class Metrics:
    """Errors of all axes together [m]: root mean square, mean absolute, largest, deviation."""

    rms: float
    mae: float
    max: float
    sigma: float

    @classmethod
    def of(cls, error: Array) -> Metrics:
        """Metrics of errors of shape (n, axes) [m]; sigma is about each axis' mean."""
        return cls(
            float(np.sqrt(np.mean(error**2))),
            float(np.mean(np.abs(error))),
            float(np.max(np.abs(error))),
            float(np.sqrt(np.mean((error - error.mean(axis=0)) ** 2))),
        )


@dataclass(frozen=True)
class Training:
    """A trained model with its errors on the held-out samples, and on the training ones.

    `before` is the error of the uncalibrated stage on the held-out samples.
    """

    model: CalibrationModel
    before: Metrics
    after: Metrics
    train_before: Metrics
    train_after: Metrics
    seconds: float
    trained_on: int
    held_out: int
    sensors: tuple[str, ...]

    def metrics(self) -> dict[str, Any]:
        """JSON-able record for the model file and the latched topic."""
        return {
            'before': asdict(self.before),
            'after': asdict(self.after),
            'train': asdict(self.train_after),
            'trained_on': self.trained_on,
            'held_out': self.held_out,
        }

    def line(self) -> str:
        """One line with the held-out error before and after."""
        return (
            f'{self.model.method}: held-out RMS {1e6 * self.before.rms:.3f} µm before, '
            f'{1e6 * self.after.rms:.3f} µm after ({self.held_out} held-out of '
            f'{self.trained_on + self.held_out} samples)'
        )


def train(
    samples: Samples,
    method: str = 'structured',
    options: dict[str, Any] | None = None,
    seed: int = 0,
    by: str = 'position',
    progress: Callable[[int, float], None] | None = None,
    abort: Callable[[], bool] | None = None,
) -> Training:
    """Fit a method on 70 % of the samples and judge it on the rest.

    Parameters
    ----------
    seed
        Of the split, and of the method where it has a seed and `options` name none.
    by
        How samples are held out, see `prepare.split`.
    progress, abort
        For methods that iterate.

    The thermal method gets the derivatives of the temperatures where the session is long enough
    for them, unless `options` say otherwise.

    Raises
    ------
    StageError
        If the data do not suffice, or the training was aborted.
    """
    samples = with_useful_sensors(samples)
    training, held = split(samples, seed=seed, by=by)
    settings = _with_seed(method, options or {}, seed)
    if 'derivatives' in METHODS[method].defaults and samples.heat is not None:
        settings = {'derivatives': samples.rates is not None, **settings}
    model = make_model(method, **settings)
    model.progress, model.abort = progress, abort
    started = time.perf_counter()
    model.fit(training.command, training.measured, training.direction, training.heat_for(model))
    seconds = time.perf_counter() - started
    return Training(
        model,
        Metrics.of(held.measured - held.command),
        evaluate(model, held),
        Metrics.of(training.measured - training.command),
        evaluate(model, training),
        seconds,
        len(training),
        len(held),
        samples.sensors,
    )


def with_useful_sensors(samples: Samples) -> Samples:
    """The samples with those temperature sensors that moved by `LEAST_WARMING` or more.

    A steady temperature has no effect that data could show, and its column would stand for a
    constant that the model already has.
    """
    kept = np.flatnonzero(np.ptp(samples.temperatures, axis=0) >= LEAST_WARMING)
    return samples.only(tuple(samples.sensors[i] for i in kept))


def evaluate(model: CalibrationModel, samples: Samples) -> Metrics:
    """Errors of a model's prediction of the measured points."""
    return Metrics.of(samples.measured - predict(model, samples))


def predict(model: CalibrationModel, samples: Samples) -> Array:
    """Table points (n, axes) [m] that a model predicts for samples with its sensors."""
    heat = samples.heat_for(model) if model.sensors else None
    return model.predict(samples.command, samples.direction, heat)


def find_bags(paths: Sequence[str]) -> list[Path]:
    """The bags that paths name: each a bag, an mcap file, or a folder of bags.

    Raises
    ------
    StageError
        If a path does not exist or holds no bag.
    """
    # Only here: the bags are not needed to train from the live buffer.
    from session_bags import archive

    return [bag for path in paths for bag in archive.find_bags(path)]


def twin_leads(session: Session) -> list[float] | None:
    """Lead of each axis' screw from the session's nominal twin [m], None where it has none."""
    axes = (session.twin or {}).get('axes', {})
    try:
        leads = [float(axes[axis]['lead']) for axis in session.axes]
    except (KeyError, TypeError, ValueError):
        return None
    return leads if all(lead > 0.0 for lead in leads) else None


def default_options(method: str, leads: list[float] | None) -> dict[str, Any]:
    """Options that a session settles: the screw's leads [m] from its nominal twin."""
    if leads is not None and 'lead' in METHODS.get(method, Structured).defaults:
        return {'lead': leads}
    return {}


def stored(
    training: Training, bags: list[Path], machine: str, version: int, seed: int
) -> StoredModel:
    """The model with its provenance, ready to be written."""
    return StoredModel(
        training.model,
        machine,
        version,
        {name: bag_hash(bag) for name, bag in zip(_names(bags), bags, strict=True)},
        training.metrics(),
        seed,
        training.sensors,
    )


def _names(bags: list[Path]) -> list[str]:
    """Names that tell bags apart: each bag's own, or its path where another has the same."""
    names = [bag.name for bag in bags]
    return [n if names.count(n) == 1 else str(b) for n, b in zip(names, bags, strict=True)]


def _with_seed(method: str, options: dict[str, Any], seed: int) -> dict[str, Any]:
    cls = METHODS.get(method)
    if cls is not None and 'seed' in cls.defaults:
        return {'seed': seed, **options}
    return options
