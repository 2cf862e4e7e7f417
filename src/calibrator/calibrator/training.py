"""Training a method on samples, with its errors on held-out positions."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calibrator.gain import Gain, held_out_gain
from calibrator.model_file import StoredModel, bag_hash
from calibrator.models import METHODS, make_model
from calibrator.models.base import CalibrationModel
from calibrator.models.selection import conditions, deviation
from calibrator.outliers import wild
from calibrator.places import judged_places
from calibrator.prepare import FEWEST_HELD, splits, told_apart
from calibrator.samples import Samples
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.metrics import Metrics
from stage_core.quantities import AXES
from stage_core.session import Session

SESSIONS, HALVES = 'whole sessions are', 'half of the time is'
BORDER = 'half of the places is'
"""What is left out beside places, in the words of a gain."""
NOT_TOLD = 'drift was not told apart from the error of the stage: '
ONCE = NOT_TOLD + f'fewer than {FEWEST_HELD} places were visited at two times'
FEW = NOT_TOLD + 'half of the samples are too few for this method'
"""What is said of one session whose halves in time share few places, or cannot be trained on."""
LEAST_WARMING = 0.3
"""Change of a sensor [K] from which its temperature is a regressor."""


@dataclass(frozen=True)
class Training:
    """A trained model with its errors on the held-out samples, and on the training ones.

    `before` is the error of the uncalibrated stage on the held-out samples, `gain` what the model
    takes off it where it takes off least, and `at_places` at these samples; `wild` counts the
    samples that were left out as outliers. `drift` is `ONCE`, `FEW` or empty.
    """

    model: CalibrationModel
    before: Metrics
    after: Metrics
    train_after: Metrics
    gain: Gain
    at_places: Gain
    drift: str
    seconds: float
    samples: int
    held_out: int
    wild: int
    sensors: tuple[str, ...]
    speeds: tuple[float, float] = (0.0, 0.0)
    sessions: int = 1

    def metrics(self) -> dict[str, Any]:
        """JSON-able record for the model file and the latched topic."""
        return {
            'before': asdict(self.before),
            'after': asdict(self.after),
            'train': asdict(self.train_after),
            'gain': asdict(self.gain),
            'drift': self.drift,
            'samples': self.samples,
            'held_out': self.held_out,
            'wild': self.wild,
            'sessions': self.sessions,
            'domain': self.domain(),
        }

    def domain(self) -> dict[str, Any]:
        """Travel [m], temperatures [degC] and speeds [m/s] that the model has seen, by name."""
        seen = self.model.domain
        assert seen is not None
        heat = len(self.sensors)
        ends = zip(seen.low.tolist(), seen.high.tolist(), strict=True)
        warmth = zip(seen.coldest[:heat].tolist(), seen.hottest[:heat].tolist(), strict=True)
        return {
            'travel': dict(zip(AXES, ends, strict=False)),
            'temperatures': dict(zip(self.sensors, warmth, strict=True)),
            'speeds': list(self.speeds),
        }

    def line(self) -> str:
        """One line with the held-out error before and after, and what else was left out."""
        wild = f'; {self.wild} wild samples left out' if self.wild else ''
        parts = [
            f'{self.model.method}: held-out RMS {1e6 * self.before.rms:.3f} µm before, '
            f'{1e6 * self.after.rms:.3f} µm after, {self.at_places} ({self.held_out} held-out of '
            f'{self.samples} samples, {self.at_places.places} places{wild})'
        ]
        if self.gain.left_out:
            parts.append(f'{self.gain} ({self.gain.places} places)')
        return '; '.join([*parts, self.drift] if self.drift else parts)


def train(
    samples: Samples,
    method: str = 'structured',
    options: dict[str, Any] | None = None,
    seed: int = 0,
    by: str = 'position',
    progress: Callable[[int, float], None] | None = None,
) -> Training:
    """Fit a method on a part of the samples and judge it on the rest.

    Of several sessions whole ones are left out, too, of one each half of its time. The worse gain
    counts. Where the places suffice for one draw (see `prepare.splits`) the model is the one that
    was judged; else one of all samples, judged by those that were fitted without each place.

    Parameters
    ----------
    seed
        Of the split, and of the method where it has a seed and `options` name none.
    by
        How samples are held out, see `prepare.splits`.
    progress
        Called with each iteration and the best error so far, by methods that iterate.

    The thermal method gets the derivatives of the temperatures where the session is long enough
    for them, unless `options` say otherwise.

    Raises
    ------
    StageError
        If the data do not suffice.
    """
    samples, left_out = _usable(samples)
    pairs = splits(samples, seed=seed, by=by)
    settings = _settings(method, options or {}, seed, samples)

    def fit(part: Samples) -> CalibrationModel:
        return _fitted(make_model(method, **settings), part, progress)

    started = time.perf_counter()
    models = [fit(training) for training, _ in pairs]
    seconds = (time.perf_counter() - started) / len(pairs)
    before, after, at_places = _judged(models, pairs, seed)
    gain, drift = _apart(at_places, fit, samples, seed)
    training, model = (pairs[0][0], models[0]) if len(pairs) == 1 else (samples, fit(samples))
    return Training(
        model,
        Metrics.of(before),
        Metrics.of(after),
        Metrics.of(training.measured - predict(model, training)),
        gain,
        at_places,
        drift,
        seconds,
        len(samples),
        len(before),
        left_out,
        samples.sensors if model.sensors else (),
        speeds(samples),
        1 if samples.session is None else len(np.unique(samples.session)),
    )


def judged_by(result: Training, held: Sequence[Samples], seed: int) -> Training:
    """The training judged at whole other sessions as well; the worse gain counts.

    The model's deviation grows to what it leaves of their repeats, where it has been.
    """
    model, pairs = result.model, [(part, part.only(result.sensors)) for part in held]
    other = _judged([model] * len(pairs), pairs, seed)[2]
    if known := [left for _, part in pairs if len(left := _left(model, part))]:
        model.spread = np.maximum(model.spread, deviation(np.vstack(known)))
    gain = _worse(result.gain, other, SESSIONS)
    drift = '' if known else result.drift
    return replace(result, gain=gain, drift=drift, sessions=result.sessions + len(known))


def _left(model: CalibrationModel, part: Samples) -> Array:
    """Errors (n, axes) [m] that a model leaves in its domain, means of the repeats of a place."""
    heat = part.temperatures[:, :0]
    left = conditions(
        part.command, part.measured - predict(model, part), part.direction, heat, None
    )
    assert model.domain is not None
    return left.error[model.domain.knows(left.command)]


def _apart(
    gain: Gain, fit: Callable[[Samples], CalibrationModel], samples: Samples, seed: int
) -> tuple[Gain, str]:
    """The gain, or the worse one where whole sessions, or halves of one, are left out; `drift`."""

    def judged(pairs: list[tuple[Samples, Samples]]) -> Gain:
        return _judged([fit(part) for part, _ in pairs], pairs, seed)[2]

    if pairs := splits(samples, seed=seed, by='session'):
        return _worse(gain, judged(pairs), SESSIONS), ''
    halves = splits(samples, seed=seed, by='half')
    told = told_apart(halves)
    if not halves:
        return gain, ONCE
    try:
        other = judged(halves)
    except StageError:
        # A number of terms that a user asks for may be too large for half of the places.
        return gain, FEW if told else ONCE
    return _worse(gain, other, HALVES if told else BORDER), '' if told else ONCE


def _worse(gain: Gain, other: Gain, left_out: str) -> Gain:
    return min(gain, replace(other, left_out=left_out), key=lambda found: found.low)


def _fitted(
    model: CalibrationModel, part: Samples, progress: Callable[[int, float], None] | None
) -> CalibrationModel:
    model.progress = progress
    heat = part.heat_for(model)
    return model.fit(part.command, part.measured, part.direction, heat, part.session)


def _usable(samples: Samples) -> tuple[Samples, int]:
    """Samples without the wild ones and the sensors that say nothing; how many were wild."""
    strange = np.zeros(len(samples), dtype=bool)
    if samples.at_rest:  # a moving stage sticks and slips: its peaks are no outliers
        strange = wild(samples.command, samples.measured - samples.command)
    return with_useful_sensors(samples.take(~strange)), int(strange.sum())


def _judged(
    models: Sequence[CalibrationModel], pairs: Sequence[tuple[Samples, Samples]], seed: int
) -> tuple[Array, Array, Gain]:
    """Errors (n, axes) [m] of the stage and of the models at what they did not see; the gain."""
    held = [held for _, held in pairs]
    before = np.vstack([part.measured - part.command for part in held])
    after = np.vstack([p.measured - predict(m, p) for m, p in zip(models, held, strict=True)])
    places = judged_places(np.vstack([part.command for part in held]))
    return before, after, held_out_gain(before, after, places, seed)


def speeds(samples: Samples) -> tuple[float, float]:
    """Least and largest speed [m/s] of the commands; zero at rest."""
    if samples.at_rest:
        return 0.0, 0.0
    steps = np.linalg.norm(np.diff(samples.command, axis=0), axis=1)
    pause = np.diff(samples.times)
    # Between two sessions nothing moved.
    speed = steps[pause > 0.0] / pause[pause > 0.0]
    return float(speed.min()), float(np.quantile(speed, 0.99))


def with_useful_sensors(samples: Samples) -> Samples:
    """The samples with those temperature sensors that moved by `LEAST_WARMING` or more.

    A steady temperature has no effect that data could show, and its column would stand for a
    constant that the model already has.
    """
    kept = np.flatnonzero(np.ptp(samples.temperatures, axis=0) >= LEAST_WARMING)
    return samples.only(tuple(samples.sensors[i] for i in kept))


def predict(model: CalibrationModel, samples: Samples) -> Array:
    """Table points (n, axes) [m] that a model predicts for samples with its sensors."""
    heat = samples.heat_for(model) if model.sensors else samples.temperatures[:, :0]
    assert heat is not None
    return samples.command + model.error(samples.command, samples.direction, heat)


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
    if leads is not None and 'lead' in METHODS[method].defaults:
        return {'lead': leads}
    return {}


def stored(
    training: Training, bags: list[Path], machine: str, version: int, seed: int, refusal: str = ''
) -> StoredModel:
    """The model with its provenance, ready to be written; `refusal` marks one that was forced."""
    metrics = training.metrics()
    return StoredModel(
        training.model,
        machine,
        version,
        {name: bag_hash(bag) for name, bag in zip(_names(bags), bags, strict=True)},
        {**metrics, 'refusal': refusal} if refusal else metrics,
        seed,
        training.sensors,
    )


def _names(bags: list[Path]) -> list[str]:
    """Names that tell bags apart: each bag's own, or its path where another has the same."""
    names = [bag.name for bag in bags]
    return [n if names.count(n) == 1 else str(b) for n, b in zip(names, bags, strict=True)]


def _settings(method: str, options: dict[str, Any], seed: int, samples: Samples) -> dict[str, Any]:
    """The options, and what the method takes beside them: the seed, derivatives if there are."""
    known = METHODS[method].defaults
    settings: dict[str, Any] = {'seed': seed} if 'seed' in known else {}
    if 'derivatives' in known and samples.heat is not None:
        settings['derivatives'] = samples.rates is not None
    return {**settings, **options}
