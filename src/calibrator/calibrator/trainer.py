"""Runs training jobs in a process of their own, one at a time, and can end them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from concurrent.futures import Future
from pathlib import Path

from calibrator.training_job import Job
from stage_core.errors import StageError


class Trainer:
    """One training process at a time.

    The future of `start` holds the one-line result, or a StageError. Its callbacks run in the
    thread that reads the process.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None
        self._aborted = False
        self.progress: tuple[int, float] | None = None

    @property
    def running(self) -> bool:
        """Whether a training is under way."""
        return self._process is not None

    def start(self, job: Job, job_file: Path) -> Future[str]:
        """Start a job, whose description is written to `job_file`.

        Raises
        ------
        StageError
            If a training is under way already.
        """
        if self.running:
            raise StageError('a training is under way: wait for it or call ~/abort')
        job.save(job_file)
        self._aborted, self.progress = False, None
        # The same interpreter and packages, also where they came by way of sys.path alone.
        environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(p for p in sys.path if p)}
        self._process = subprocess.Popen(
            [sys.executable, '-m', 'calibrator.training_job', str(job_file)],
            # Never written to: its end tells the training that this process has died.
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        )
        future: Future[str] = Future()
        threading.Thread(target=self._follow, args=(self._process, future), daemon=True).start()
        return future

    def abort(self) -> bool:
        """End the training under way; whether there was one."""
        process = self._process
        if process is None:
            return False
        self._aborted = True
        process.terminate()
        return True

    def _follow(self, process: subprocess.Popen[str], future: Future[str]) -> None:
        assert process.stdout is not None and process.stderr is not None
        last: dict[str, object] = {}
        with process:
            for line in process.stdout:
                try:
                    last = json.loads(line)
                except json.JSONDecodeError:
                    continue
                step = last.get('progress')
                if isinstance(step, list):
                    self.progress = (int(step[0]), float(step[1]))
            failure = process.stderr.read()
        self._process = None
        if self._aborted:
            future.set_exception(StageError('the training was aborted: the old model stays'))
        elif 'result' in last:
            future.set_result(str(last['result']))
        elif 'error' in last:
            future.set_exception(StageError(str(last['error'])))
        else:
            tail = ' '.join(failure.split())[-300:]
            future.set_exception(
                StageError(f'the training process ended with {process.returncode}: {tail}')
            )
