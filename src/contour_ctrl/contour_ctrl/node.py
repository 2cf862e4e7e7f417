"""The contour controller's node: parameters, `~/run`, `~/abort`, progress."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any

import numpy as np
from sensor_msgs.msg import Temperature
from std_msgs.msg import String
from std_srvs.srv import Trigger

from calibrator.temperatures import LiveTemperatures
from contour_ctrl import contour_parameters as parameters
from contour_ctrl import storage
from contour_ctrl.calibration import announced_model, inverse, temperatures_line
from contour_ctrl.figures import Figures
from contour_ctrl.planning import Planning
from contour_ctrl.sequence import ContourRun
from contour_ctrl.streaming_node import StreamingNode
from stage_core import topics
from stage_core.errors import StageError
from stage_core.ros.node import ERROR, LATCHED_QOS, OK, STATE_QOS, run, stamp_of
from stage_core.ros.services_node import create_deferred_service, create_trigger_service
from stage_core.untrusted import json_object


class ContourCtrl(StreamingNode):
    """Follows a contour as often as asked, and learns in between."""

    def __init__(self) -> None:
        super().__init__('contour_ctrl', parameters.PARAMETERS)
        self._model: dict[str, Any] = {}
        self._temperatures = LiveTemperatures()
        self._curve_text: str | None = None
        self._progress: list[Figures] = []
        self._last_message = ''
        self._last_failed = False
        self._planning: Planning | None = None
        self.create_subscription(String, topics.MODEL, self._on_model, LATCHED_QOS)
        self.create_subscription(Temperature, topics.TEMPERATURE, self._on_temperature, STATE_QOS)
        self.create_subscription(String, '~/curve', self._on_curve, LATCHED_QOS)
        create_deferred_service(self, Trigger, '~/run', lambda _: self._run())
        create_trigger_service(self, '~/abort', self._abort)
        self.diagnostics.task('contour', self._contour_status)
        parameters.check_curve(self.value)

    def parameters_changed(self, changed: dict[str, Any]) -> str | None:
        """Refuse a curve file that the contour cannot be made of."""
        try:
            if 'curve_file' in changed:
                parameters.check_curve(lambda name: changed.get(name, self.value(name)))
        except StageError as error:
            return str(error)
        return None

    def shutdown(self) -> None:
        """Leave the stage with a target to rest at."""
        self._fault('the contour controller shuts down')

    def silence_limit(self) -> float:
        """Silence of the encoder that ends a run [s] of wall time."""
        return float(self.value('lockstep_timeout' if self.lockstep else 'encoder_timeout'))

    def run_ended(self, course: ContourRun) -> None:
        """Keep the best of what was learned; remember the outcome for the diagnostics."""
        self._last_message, self._last_failed = course.message, not course.success
        self._missed_before = course.missed
        folder = self.value('session_folder')
        if not (course.success and folder) or self.value('contour') == parameters.TIMED:
            return
        signal, weights = np.zeros_like(course.controller.learned), course.best_weights
        if course.learner is not None and course.learner.best is not None:
            signal, weights = course.learner.best.signal, course.learner.best.weights
        if not (signal.any() or weights.any()):
            return
        of = course.controller.reference.digest(), self.value('machine')
        scheme = self.value('scheme')
        storage.save(
            storage.file_of(folder, *of, scheme),
            storage.Learned(*of, signal, weights),
            {'scheme': scheme, 'result': course.message},
        )

    def _run(self) -> Future[str]:
        if self._planning is not None and self._planning.aborted:
            raise StageError('an aborted contour is still being planned: try again in a moment')
        if self.course is not None or self._planning is not None:
            raise StageError('a contour is being followed already: call ~/abort first')
        # All that is planned with is of this moment, whatever changes meanwhile.
        values = {p.name: self.value(p.name) for p in parameters.PARAMETERS}
        self._planning = Planning(
            values.__getitem__,
            self._curve_text,
            self._inverse_model(),
            self.lockstep,
            self._on_iteration,
        )
        return self._planning.answer

    def _watch(self) -> None:
        if self._planning is not None and self._planning.done:
            planning, self._planning = self._planning, None
            if not planning.aborted:
                self._begin_planned(planning)
        super()._watch()

    def _begin_planned(self, planning: Planning) -> None:
        try:
            course = planning.result()
        except Exception as error:
            planning.answer.set_exception(error)
            return
        reference = course.controller.reference
        self._progress.clear()
        self.get_logger().info(
            f'{len(reference)} ticks per iteration, feed {reference.feed:g} m/s, '
            f'fluctuation {100.0 * reference.fluctuation:.2g} %'
        )
        self.begin(course, planning.answer)

    def _inverse_model(self) -> Callable[[np.ndarray], np.ndarray] | None:
        """Return the inverse of the active calibration model, None where none is active."""
        if not (self.value('use_model') and self._model.get('active')):
            return None
        stored = announced_model(self._model)
        readings = self._temperatures.fresh(self.now())
        if stored.sensors:
            line = temperatures_line(stored, readings)
            if set(stored.sensors) <= set(readings):
                self.get_logger().info(line)
            else:
                self.get_logger().warning(line)
        rates, largest = self._temperatures.rates(readings), self._model['max_correction']
        return inverse(stored, readings, rates, largest)

    def _on_temperature(self, message: Temperature) -> None:
        self._temperatures.hear(
            message.header.frame_id, message.temperature, stamp_of(message.header), self.now()
        )

    def _on_iteration(self, index: int, result: Figures) -> None:
        self._progress.append(result)
        self.get_logger().info(f'iteration {index}: {result.sentence()}')

    def _on_model(self, message: String) -> None:
        try:
            self._model = json_object(message.data, topics.MODEL, 'it is ignored')
        except StageError as error:
            self.get_logger().error(str(error))

    def _on_curve(self, message: String) -> None:
        self._curve_text = message.data
        try:
            parameters.check_curve(self.value, message.data)
        except StageError as error:
            self.get_logger().error(str(error))

    def _abort(self) -> str:
        planned = self._abort_planning('aborted by request')
        if self.course is None and not planned:
            raise StageError('nothing to abort: no run is under way')
        self.stop_run('aborted by request')
        return 'stopping'

    def _abort_planning(self, reason: str) -> bool:
        """Whether there was a contour being planned that nobody had aborted."""
        planning = self._planning
        if planning is None or planning.aborted:
            return False
        planning.abort(reason)
        return True

    def driver_stopped(self, reason: str) -> None:
        """End the run, also while its contour is planned."""
        self._abort_planning(reason)
        super().driver_stopped(reason)

    def _contour_status(self) -> tuple[bytes, str, dict[str, Any]]:
        active = self.value('use_model') and self._model.get('active')
        values: dict[str, Any] = {
            'scheme': self.value('scheme'),
            'contour': self.value('contour'),
            'model': self._model.get('file') if active else 'none',
        }
        for index, result in enumerate(self._progress[-20:]):
            number = max(len(self._progress) - 20, 0) + index + 1
            values[f'iteration {number}'] = result.sentence()
        course = self.course
        if course is not None:
            values['tick'] = f'{course.tick + 1} of {len(course.controller)}'
            number = len(course.results) + 1
            return OK, f'iteration {number} of {course.iterations}: {course.phase.value}', values
        if self._planning is not None:
            return OK, 'planning the contour', values
        if self._last_failed:
            return ERROR, self._last_message, values
        return OK, self._last_message or 'idle', values


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(ContourCtrl, args)


if __name__ == '__main__':
    raise SystemExit(main())
