"""A training from several random starts: the swarm may end in another minimum from each."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calibrator.models import METHODS
from calibrator.samples import Samples
from calibrator.training import Training, train
from session_bags.archive import Where, map_items
from stage_core.errors import StageError
from stage_core.whole_file import write_whole


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
        Folder that keeps every start's error, see `session_bags.archive.map_items`.

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
    values = [float(outcome.result) for outcome in outcomes]
    # What a start gave is its error alone: the best one's training is made once more.
    best = starts[int(np.argmin(values))]
    return _train(samples, best, method, options, seed, by), values


def train_start(
    start: str, data: str, method: str, options: dict[str, Any], seed: int, by: str
) -> float:
    """RMS error [m] on the training samples of one training, from the seed `start`."""
    samples = Samples.from_dict(json.loads(Path(data).read_text(encoding='utf-8')))
    return _train(samples, start, method, options, seed, by).train_after.rms


def _train(
    samples: Samples, start: str, method: str, options: dict[str, Any], seed: int, by: str
) -> Training:
    return train(samples, method, {**options, 'seed': int(start)}, seed, by)


def _save(samples: Samples, folder: Path) -> Path:
    """Samples in a file named by what they hold, for the processes that train on them."""
    text = json.dumps(samples.to_dict())
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f'samples-{hashlib.sha256(text.encode()).hexdigest()[:16]}.json'
    write_whole(path, text)
    return path
