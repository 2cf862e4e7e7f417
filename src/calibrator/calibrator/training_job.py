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

from calibrator import model_file
from calibrator.live_buffer import heard, load_session
from calibrator.prepare import prepare, require_rests
from calibrator.samples import Gathered
from calibrator.training import Training, default_options, stored, train, twin_leads
from stage_core.errors import StageError
from stage_core.priority import to_background
from stage_core.whole_file import write_whole


@dataclass(frozen=True)
class Job:
    """What to train; `live` is a file of `live_buffer.save_session` where `bags` is empty.

    A model that errs by more than `max_correction` [m] on held-out samples is refused as one that
    is no better than none; `force` writes either, marked.
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
    reason = refusal(result, job.max_correction)
    if reason and not job.force:
        raise StageError(reason)
    return result, stored(result, data.bags, job.machine, job.version, job.seed, reason)


def refusal(result: Training, max_correction: float) -> str:
    """Why a model is not taken, with its figures; empty where it is."""
    if not result.gain.proven:
        return (
            f'the new model is not proven to be better than none ({result.line()}): record more '
            'distinct places, or choose a simpler method'
        )
    if result.after.rms > max_correction:
        return (
            f'the new model still errs by {1e6 * result.after.rms:.0f} µm, beyond max_correction '
            f'{1e6 * max_correction:.0f} µm ({result.line()}): check the tracker and its alignment'
        )
    return ''


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
