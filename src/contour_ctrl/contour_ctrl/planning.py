"""From parameters to a contour that is ready to run, in a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import numpy as np

from contour_ctrl import contour_parameters as parameters
from contour_ctrl import storage
from contour_ctrl.figures import Figures
from contour_ctrl.learning import Learner
from contour_ctrl.sequence import ContourRun
from contour_ctrl.tick import Controller
from stage_core.errors import StageError


def prepare(
    value: parameters.Values,
    curve_text: str | None,
    invert: Callable[[np.ndarray], np.ndarray] | None,
    lockstep: bool,
    report: Callable[[int, Figures], None],
) -> ContourRun:
    """Plan the contour and everything that its ticks need.

    Parameters
    ----------
    value
        Parameters by name.
    curve_text
        YAML of the curve that came by topic, if any.
    invert
        Map of wanted table points (n, 2) [m] to commands; None without a calibration.
    lockstep, report
        As of `RunSettings` and `ContourRun`.

    Raises
    ------
    StageError
        If the parameters make no contour, or there is no learned signal to reload.
    """
    if value('contour') == parameters.TIMED:
        reference = parameters.make_timed(value)
    else:
        reference = parameters.make_reference(value, parameters.make_curve(value, curve_text))
    if invert is not None and value('contour') != parameters.TIMED:
        reference = reference.corrected(invert)
    controller = Controller(reference, parameters.make_gains(value))
    settings = parameters.make_learning(value)
    learner = None
    if settings is not None:
        learner = Learner(len(reference), reference.period, settings)
    if value('reuse_learned'):
        _reload(value, controller, learner)
    return ContourRun(
        controller,
        learner,
        value('iterations'),
        parameters.make_run_settings(value, lockstep),
        report,
    )


def _reload(value: parameters.Values, controller: Controller, learner: Learner | None) -> None:
    if not value('session_folder'):
        raise StageError('reuse_learned needs the parameter session_folder')
    of = controller.reference.digest(), value('machine')
    path = storage.file_of(value('session_folder'), *of, value('scheme'))
    known = storage.load(path, *of)
    if known.signal.shape != controller.learned.shape:
        raise StageError(f'{path} has another number of ticks: delete it')
    if learner is not None:
        controller.learned[:] = known.signal
        learner.learned[:] = known.signal
    if known.weights.shape == controller.weights.shape:
        controller.weights[:] = known.weights
        if learner is not None:
            learner.began = known.weights.copy()


class Planning:
    """A contour that is being planned, as of `prepare`, while services and topics live.

    `answer` is for whoever asked for the contour; the run that begins when `done` answers it.
    """

    def __init__(self, *arguments: Any) -> None:
        self.answer: Future[str] = Future()
        self.aborted = False
        self._arguments = arguments
        self._outcome: Future[ContourRun] = Future()
        # A daemon: a node that is ended does not wait for a plan.
        threading.Thread(target=self._work, name='planning', daemon=True).start()

    @property
    def done(self) -> bool:
        """Whether `result` does not wait."""
        return self._outcome.done()

    def result(self) -> ContourRun:
        """The planned run; raises what its planning raised."""
        return self._outcome.result()

    def abort(self, reason: str) -> None:
        """Answer now; the thread goes on to its end, and nobody takes its plan."""
        self.aborted = True
        self.answer.set_exception(StageError(reason))

    def _work(self) -> None:
        try:
            self._outcome.set_result(prepare(*self._arguments))
        except Exception as error:
            self._outcome.set_exception(error)
