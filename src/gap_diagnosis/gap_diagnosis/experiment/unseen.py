"""Effects that a session could not show at all, fitted to it as far as they go.

Friction and play are no candidates on an axis that never turned back: the diagnosis does not ask
for them. Whether one of them imitates what was named tells the twin itself: the parameters that
make the effect what it is are fitted to the session's channels in closed loop.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.evidence.acceptance import defining
from gap_diagnosis.experiment.prediction import Predictor
from gap_diagnosis.input.checks import turns
from gap_diagnosis.input.data import Record
from gap_diagnosis.parameters import Parameters, plain_values
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.selection.rivals import LEAST_OF_REST
from stage_core.errors import StageError
from stage_twin.effects import EFFECTS, effect_of

Array = NDArray[np.float64]
Values = dict[str, dict[str, float]]

ROUNDS = 4


def names(found: Diagnosis) -> list[str]:
    """Effects that need a reversal, of the axes that moved and never turned back."""
    record = found.records[0]
    counts = turns(found.records)
    still = [a for a, moves in zip(record.axes, record.moving, strict=True) if moves]
    return [
        f'{e.name}.{a}' for a in still if counts[a] == 0 for e in EFFECTS.values() if e.reverses
    ]


def imitations(
    found: Diagnosis, predictor: Predictor, rest: Parameters, allowed: list[str]
) -> Iterator[tuple[float, str, Parameters]]:
    """Share of what `rest` leaves of the session, effect and parameters of each that imitates."""
    record = found.records[0]
    target = _shown(record, predictor)
    base = plain_values(rest)
    for name in allowed:
        try:
            share, fitted = _fit(name, base, record.reference, target, predictor)
        except StageError:
            continue
        if share > LEAST_OF_REST:
            yield share, name, {**rest, name: fitted}


def _shown(record: Record, predictor: Predictor) -> Array:
    """The channels (c, m) of the session itself, over the floors."""
    shown = [predictor.balance(record.reference, record.encoder, record.force)]
    if predictor.tracker:
        times = predictor.times(len(record.reference))
        assert record.tracker is not None and record.tracker_time is not None
        apart = record.tracker[:, : len(record.axes)] - record.encoder_at(record.tracker_time)
        points = np.array([np.interp(times, record.tracker_time, c) for c in apart.T])
        shown.append(points / predictor.noise.tracker)
    return np.concatenate(shown)


def _fit(
    name: str, base: Values, reference: Array, target: Array, predictor: Predictor
) -> tuple[float, dict[str, tuple[float, float]]]:
    """Share that an effect explains, and its parameters with deviations; Gauss-Newton."""
    effect = effect_of(name)
    free = [p for p in effect.parameters if p.name in defining(name)]
    scale = np.array([abs(p.when_on) or 0.1 * (p.maximum - p.minimum) for p in free])
    low, high = (np.array([getattr(p, e) for p in free]) for e in ('minimum', 'maximum'))

    def left(values: Array) -> Array:
        own = effect.defaults()
        own |= {p.name: v for p, v in zip(free, values.tolist(), strict=True)}
        channels, _ = predictor.channels({**base, name: own}, reference)
        return (target - channels).reshape(-1)

    bare = (target - predictor.channels(base, reference)[0]).reshape(-1)
    values = np.clip(scale, low, high)
    residual = left(values)
    for _ in range(ROUNDS):
        slopes = np.column_stack(
            [(left(values + 0.05 * s * u) - residual) / (0.05 * s)
             for s, u in zip(scale, np.eye(len(free)), strict=True)]
        )  # fmt: skip
        gram = slopes.T @ slopes + 1e-9 * np.diag(np.diag(slopes.T @ slopes) + 1e-30)
        trial = np.clip(values - np.linalg.solve(gram, slopes.T @ residual), low, high)
        moved = left(trial)
        if moved @ moved >= residual @ residual:
            break
        values, residual = trial, moved
    variance = float(residual @ residual) / max(1, len(residual) - len(free))
    deviations = np.sqrt(variance * np.diag(np.linalg.pinv(gram)))
    share = 1.0 - float(residual @ residual) / max(float(bare @ bare), 1e-300)
    fitted = {k: (v, 0.0) for k, v in effect.defaults().items()}
    for p, v, d in zip(free, values.tolist(), deviations.tolist(), strict=True):
        fitted[p.name] = (v, d)
    return share, fitted
