"""One training in a process of its own, so that a node's topics and services stay live.

``python -m calibrator.training_job JOB.json`` trains, writes the model file and prints one JSON
object per line: ``{"progress": [iteration, error]}`` and at the end ``{"result": message}`` or
``{"error": message}``. It ends when its standard input does, which the process that started it
holds open: a training that nobody waits for any more would only load the machine.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from calibrator import model_file
from calibrator.live_buffer import load_session
from calibrator.prepare import prepare
from calibrator.training import Training, default_options, stored, train, twin_leads
from stage_core.errors import StageError
from stage_core.priority import to_background

CLEARLY_WORSE = 1.25
"""A new model whose held-out error exceeds the uncalibrated one by this is refused; a few held-out
points scatter by less."""


@dataclass(frozen=True)
class Job:
    """What to train; `live` is a file of `live_buffer.save_session` where `bags` is empty."""

    out: str
    bags: list[str] = field(default_factory=list)
    live: str = ''
    method: str = 'structured'
    options: dict[str, Any] = field(default_factory=dict)
    source: str = 'reference'
    target: str = 'tracker'
    machine: str = ''
    version: int = 1
    seed: int = 0

    def save(self, path: Path) -> None:
        """Write the job as JSON."""
        path.write_text(json.dumps(asdict(self)), encoding='utf-8')

    @classmethod
    def load(cls, path: Path) -> Job:
        """Read a job that `save` wrote."""
        return cls(**json.loads(path.read_text(encoding='utf-8')))


def run_job(
    job: Job, progress: Any = None
) -> tuple[Training, model_file.StoredModel, dict[str, str]]:
    """Train as the job says; the caller writes the model.

    The last part is why bags of a folder were skipped, by bag.

    Raises
    ------
    StageError
        If the data do not suffice, or the new model is worse than no correction.
    """
    bags: list[Path] = []
    skipped: dict[str, str] = {}
    if job.bags:
        # Only here: the reader is not needed to train from the live buffer.
        from calibrator.gather import gather

        gathered = gather(job.bags, job.source, job.target)
        samples, leads = gathered.samples, gathered.leads
        bags, skipped = gathered.bags, gathered.skipped
    else:
        session = load_session(job.live)
        samples, leads = prepare(session, job.source, job.target), twin_leads(session)
    options = {**default_options(job.method, leads), **job.options}
    result = train(samples, job.method, options, job.seed, progress=progress)
    if result.after.rms > CLEARLY_WORSE * result.before.rms:
        raise StageError(
            f'the new model is worse than none ({result.line()}): record more positions or '
            'choose a simpler method'
        )
    return result, stored(result, bags, job.machine, job.version, job.seed), skipped


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

    try:
        job = Job.load(Path(sys.argv[1]))
        result, model, skipped = run_job(job, lambda i, best: say(progress=[i, best]))
        model_file.save(model, job.out)
    except StageError as error:
        say(error=' '.join(str(error).split()))
        return 2
    left_out = [f'; skipped {bag}: {reason}' for bag, reason in skipped.items()]
    say(result=''.join([result.line(), *left_out]))
    return 0


if __name__ == '__main__':
    sys.exit(main())
