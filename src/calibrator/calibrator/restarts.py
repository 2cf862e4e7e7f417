"""A training from several random starts: the swarm may end in another minimum from each."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from calibrator.gain import Gain
from calibrator.gather import ARRAYS
from calibrator.models import METHODS
from calibrator.samples import Samples
from calibrator.training import Training, train
from session_bags.archive import Where, map_items
from stage_core.errors import StageError
from stage_core.metrics import Metrics
from stage_core.whole_file import replacing

_NUMBERS = ('seconds', 'samples', 'held_out', 'wild')
_METRICS = ('before', 'after', 'train_after')


def train_restarts(
    samples: Samples,
    method: str,
    options: dict[str, Any],
    seed: int,
    by: str,
    count: int,
    results: str | Path,
    where: Where | None = None,
) -> tuple[Training, Sequence[float]]:
    """The training with the least RMS on its *training* samples, and that RMS [m] of each start.

    Starts are the seeds `seed` .. `seed + count - 1` of the method; the split into training and
    held-out samples is that of `seed` for all, and the held-out ones have no part in the choice.

    Parameters
    ----------
    results
        Folder that keeps every start's training, see `session_bags.archive.map_items`.

    Raises
    ------
    StageError
        If the method has no random start, or a training fails.
    """
    if 'seed' not in METHODS[method].defaults:
        random = ', '.join(name for name, cls in METHODS.items() if 'seed' in cls.defaults)
        raise StageError(
            f'{method} has no random start: leave --restarts out, or choose one of {random}'
        )
    data = _save(samples, Path(results))
    work = functools.partial(
        train_start, data=str(data), method=method, options=options, seed=seed, by=by
    )
    settings = json.dumps([data.name, method, options, seed, by], sort_keys=True)
    starts = [str(seed + number) for number in range(count)]
    outcomes = map_items(work, starts, results, lambda start: settings + start, where)
    for outcome in outcomes:
        if outcome.error:
            raise StageError(f'the training from seed {outcome.item} failed: {outcome.error}')
    found = [_training(outcome.result) for outcome in outcomes]
    values = [training.train_after.rms for training in found]
    return found[int(np.argmin(values))], values


def train_start(
    start: str, data: str, method: str, options: dict[str, Any], seed: int, by: str
) -> dict[str, Any]:
    """One training, from the seed `start`, as JSON can hold it."""
    with np.load(data) as content:
        fields: dict[str, Any] = json.loads(str(content['text']))
        fields.update({name: content[name] for name in ARRAYS if name in content})
    fields.update({name: tuple(fields[name]) for name in ('axes', 'sensors')})
    samples = Samples(**fields)
    result = train(samples, method, {**options, 'seed': int(start)}, seed, by)
    return {
        **{name: asdict(getattr(result, name)) for name in _METRICS},
        'model': result.model.to_dict(),
        'gain': asdict(result.gain),
        **{name: getattr(result, name) for name in _NUMBERS},
        'sensors': list(result.sensors),
        'speeds': list(result.speeds),
    }


def _training(content: dict[str, Any]) -> Training:
    fields = dict(content)
    for name in _METRICS:
        fields[name] = Metrics(**fields[name])
    fields['gain'] = Gain(**fields['gain'])
    model = METHODS[fields['model']['method']].from_dict(fields.pop('model'))
    fields.update({name: tuple(fields[name]) for name in ('sensors', 'speeds')})
    return Training(model=model, **fields)


def _save(samples: Samples, folder: Path) -> Path:
    """Samples in a file named by what they hold, for the processes that train on them."""
    words = {k: getattr(samples, k) for k in ('sensors', 'axes', 'shift', 'at_rest')}
    text = json.dumps(words)
    digest = hashlib.sha256(text.encode())
    arrays = {name: a for name in ARRAYS if (a := getattr(samples, name)) is not None}
    for values in arrays.values():
        digest.update(np.ascontiguousarray(values).tobytes())
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f'samples-{digest.hexdigest()[:16]}.npz'
    with replacing(path) as stream:
        np.savez(stream, text=np.array(text), **arrays)
    return path
