"""One training in a process of its own, so that a node's topics and services stay live.

``python -m calibrator.training_job JOB.json`` trains, writes the model file and prints one JSON
object per line: ``{"progress": [iteration, error]}`` and at the end ``{"result": message}`` or
``{"error": message}``. It ends when its standard input does, which the process that started it
holds open: a training that nobody waits for any more would only load the machine.

`run_job` is also what ``ros2 run calibrator retrain_offline`` calls, with the same refusals.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from calibrator import model_file
from calibrator.live_buffer import heard, load_session
from calibrator.prepare import prepare, require_rests
from calibrator.samples import Gathered, Samples
from calibrator.training import (
    BORDER,
    HALVES,
    SESSIONS,
    Training,
    default_options,
    predict,
    stored,
    train,
    twin_leads,
)
from stage_core.errors import StageError
from stage_core.priority import to_background
from stage_core.tracker_frame import other_unit, turned
from stage_core.whole_file import write_whole

NOISE = 1.5
"""An error before is noise up to so many times what the model leaves of its training.

Of noise alone (50 samples there and back, 40 at random; three methods, 20 seeds) it is 0.7 to 1.5
times as large, of a zero that drifts by 10 µm in a grid there and back 2 times.
"""
DRIFTED = -0.3
"""A gain below this where half of the time is left out is a drift, even where all of the data are
no better than noise: noise gave -0.15 or more in 24 trainings, a zero that steps or drifts about
its mean -0.4 or less in 48.
"""
BACKWARDS = 'it predicts the reference, not the table: train one with the target tracker'
REMEDIES = {
    SESSIONS: 'the sessions disagree (another machine, reflector or day), or hold only noise: '
    'train them apart, or calibrate again',
    HALVES: 'the machine or the tracker drifted: let them settle and repeat',
    BORDER: 'record more distinct places, and visit each at two times',
    '': 'record more distinct places, or choose a simpler method',
}
"""What to do about an unproven gain, by what was left out for it."""


@dataclass(frozen=True)
class Job:
    """What to train; `live` is a file of `live_buffer.save_session` where `bags` is empty.

    A model that corrects by more than `max_correction` [m], or still errs by more on held-out
    samples, is refused as one that is no better than none; `force` writes either, marked.
    """

    out: str
    bags: list[str] = field(default_factory=list)
    live: str = ''
    method: str = 'structured'
    options: dict[str, Any] = field(default_factory=dict)
    source: str = 'reference'
    target: str = 'tracker'
    by: str = 'position'
    machine: str = ''
    version: int = 1
    seed: int = 0
    max_correction: float = 1e-3
    force: bool = False

    def save(self, path: Path) -> None:
        """Write the job as JSON."""
        write_whole(path, json.dumps(asdict(self)))

    @classmethod
    def load(cls, path: Path) -> Job:
        """Read a job that `save` wrote."""
        return cls(**json.loads(path.read_text(encoding='utf-8')))


def read(job: Job) -> Gathered:
    """The data that a job trains on.

    Raises
    ------
    StageError
        If a bag cannot be read, holds no pairs or is no calibration.
    """
    if not job.bags:
        session = load_session(job.live)
        samples = prepare(session, job.source, job.target)
        require_rests(samples, job.target)
        return Gathered(samples, twin_leads(session))
    # Only here: the reader is not needed to train from the live buffer.
    from calibrator.gather import gather

    return gather(job.bags, job.source, job.target)


def run_job(
    job: Job,
    data: Gathered | None = None,
    progress: Callable[[int, float], None] | None = None,
    training: Callable[[dict[str, Any]], Training] | None = None,
) -> tuple[Training, model_file.StoredModel]:
    """Train as the job says, and refuse what must not be taken; the caller writes the model.

    Parameters
    ----------
    data
        What `read` gave, where it was called before.
    training
        Trains with the settled options of the method, instead of one call of `training.train`.

    Raises
    ------
    StageError
        If the data do not suffice, or the model is not proven to be better than none (unless the
        job is forced).
    """
    data = data or read(job)
    settings = {**default_options(job.method, data.leads), **job.options}
    if training is None:
        result = train(data.samples, job.method, settings, job.seed, job.by, progress)
    else:
        result = training(settings)
    reason = refusal(result, data.samples, job)
    if reason and not job.force:
        raise StageError(reason)
    mark = reason or (BACKWARDS if job.target == 'reference' else '')
    return result, stored(result, data.bags, job.machine, job.version, job.seed, mark)


def refusal(result: Training, samples: Samples, job: Job) -> str:
    """Why a model of these samples is not taken, with its figures; empty where it is."""
    predicted = predict(result.model, samples.only(result.sensors))
    correction = float(np.abs(predicted - samples.command).max())
    limit = f'beyond max_correction {1e6 * job.max_correction:.0f} µm ({result.line()})'
    if correction > job.max_correction:
        return (
            f'the new model corrects by up to {1e6 * correction:.0f} µm, {limit}: '
            f'{_too_large(samples, job)}'
        )
    if not result.gain.proven:
        return (
            f'the new model is not proven to be better than none ({result.line()}): '
            f'{_remedy(result)}'
        )
    if result.after.rms > job.max_correction:
        return (
            f'the new model still errs by {1e6 * result.after.rms:.0f} µm, {limit}: check the '
            'tracker and its alignment'
        )
    return ''


def _too_large(samples: Samples, job: Job) -> str:
    """What is likely wrong where a stage seems to err by more than any stage does."""
    if unit := other_unit(samples.measured, samples.command, f'the {job.source}'):
        return f'the {job.target} {unit}'
    if frame := turned(samples.measured, samples.command):
        return f'in the points of the {job.target} {frame}'
    return 'align the tracker again (/tracker_bridge/align), or raise max_correction'


def _remedy(result: Training) -> str:
    """What to do about a gain that is not proven."""
    gain = result.gain
    differ = gain.left_out == SESSIONS or (gain.left_out == HALVES and gain.value < DRIFTED)
    if not differ and result.before.rms <= NOISE * result.train_after.rms:
        return 'there is nothing to correct: the error before is as small as the noise'
    return REMEDIES[gain.left_out]


def _heard_live(job: Job) -> str:
    """What a job without a bag learns from, to end its answer with."""
    if job.bags:
        return ''
    held = heard(load_session(job.live))
    return f'; data: what was heard live (the parameter bag is empty), {held}'


def _end_with_input() -> None:
    """End this process, at once and from any thread, when standard input ends."""
    os.read(sys.stdin.fileno(), 1)
    os._exit(3)


def main() -> int:
    """Entry point of the process."""
    threading.Thread(target=_end_with_input, daemon=True).start()
    to_background()

    def say(**content: Any) -> None:
        print(json.dumps(content), flush=True)

    job = Job.load(Path(sys.argv[1]))
    live = _heard_live(job)
    try:
        data = read(job)
        result, model = run_job(job, data, lambda i, best: say(progress=[i, best]))
        model_file.save(model, job.out)
    except StageError as error:
        say(error=' '.join(str(error).split()) + live)
        return 2
    left_out = [f'; skipped {bag}: {reason}' for bag, reason in data.skipped.items()]
    say(result=''.join([result.line(), *left_out, live]))
    return 0


if __name__ == '__main__':
    sys.exit(main())
