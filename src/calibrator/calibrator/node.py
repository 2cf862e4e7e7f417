"""Node that learns the stage's error and corrects the command path."""

from __future__ import annotations

import json
import sys
import tempfile
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped, TransformStamped
from rclpy.clock import Clock, ClockType
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from calibrator import model_file
from calibrator.adaptation import LiveAdaptation
from calibrator.correction import Correction
from calibrator.live_buffer import LiveBuffer, save_session
from calibrator.models import make_model
from calibrator.parameters import PARAMETERS
from calibrator.temperatures import Rates
from calibrator.trainer import Trainer
from calibrator.training_job import Job
from stage_core import topics
from stage_core.errors import StageError
from stage_core.frames import alignment_in
from stage_core.quantities import AXES
from stage_core.ros.batch_node import Batches
from stage_core.ros.node import (
    ERROR,
    LATCHED_QOS,
    OK,
    SETPOINT_QOS,
    STATE_QOS,
    WARN,
    JointStateReader,
    StageNode,
    joint_state,
    run,
    stamp_of,
)
from stage_core.ros.services_node import create_deferred_service, create_trigger_service
from stage_core.untrusted import json_object

NO_ADAPTATION = 'no adaptation: '


class Calibrator(StageNode):
    """Subscribes what training needs, answers ``~/retrain`` and corrects ``/stage/target``."""

    def __init__(self) -> None:
        super().__init__('calibrator', PARAMETERS)
        self._correction = Correction(self.value('max_correction'))
        self._buffer = LiveBuffer(self.value('buffer_size'))
        self._trainer = Trainer()
        self._file = ''
        self._failure = ''
        self._refusal = ''
        self._refused = 0
        self._adaptation: LiveAdaptation | None = None
        self._scratch = tempfile.TemporaryDirectory(prefix='calibrator-')
        self._setpoints = self.create_publisher(JointState, topics.SETPOINT, SETPOINT_QOS)
        self._models = self.create_publisher(String, topics.MODEL, LATCHED_QOS)
        subscribe = self.create_subscription
        subscribe(JointState, topics.TARGET, self._on_target, SETPOINT_QOS)
        self._reader = JointStateReader()
        self._batches = Batches(self)
        self._batches.create_subscription(JointState, topics.REFERENCE, self._on_reference)
        subscribe(PointStamped, topics.TRACKER_POINT, self._on_point, STATE_QOS)
        subscribe(TransformStamped, topics.ALIGNMENT, self._on_alignment, LATCHED_QOS)
        subscribe(Temperature, topics.TEMPERATURE, self._on_temperature, STATE_QOS)
        create_deferred_service(self, Trigger, '~/retrain', lambda _: self._retrain())
        self.create_service(SetBool, '~/activate', self._on_activate)
        create_trigger_service(self, '~/abort', self._abort)
        create_trigger_service(self, '~/load', self._load)
        self.diagnostics.task('model', self._status)
        # Steady time: simulated time stands still while nobody moves the stage.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0, self._adapt, clock=steady)
        if self.value('model_file'):
            self._use(Path(self.value('model_file')))
        self._announce()

    def shutdown(self) -> None:
        """End a training under way and remove scratch files."""
        self._trainer.abort()
        self._scratch.cleanup()

    def parameters_changed(self, changed: dict[str, Any]) -> str | None:
        """Refuse options that the method does not know."""
        if 'max_correction' in changed:
            self._correction.max_correction = float(changed['max_correction'])
            self._announce()
        if not {'method', 'options'} & set(changed):
            return None
        try:
            method = str(changed.get('method', self.value('method')))
            make_model(method, **_options(str(changed.get('options', self.value('options')))))
        except StageError as error:
            return str(error)
        return None

    def _on_target(self, message: JointState) -> None:
        axes = tuple(message.name)
        known = tuple(axis for axis in AXES if axis in axes)
        if len(message.position) != len(axes) or len(known) != len(axes):
            self._refuse(f'{topics.TARGET} needs one position for each of the axes x, y')
            return
        target = np.array([message.position[axes.index(axis)] for axis in known])
        self._batches.take()
        standing = self._buffer.standing(known)
        try:
            command = self._correction.apply(target, self._fresh(), self._rates(), standing)
        except StageError as error:
            self._refuse(str(error))
            return
        self._refusal = ''
        stamp = stamp_of(message.header)
        self._setpoints.publish(joint_state(stamp, known, position=command.tolist()))

    def _refuse(self, reason: str) -> None:
        self._refused += 1
        self._refusal = reason
        self.get_logger().error(reason)

    def _on_reference(self, data: bytes, _: dict[str, int]) -> None:
        message = self._reader.read(data)
        if message is None:
            return
        axes = tuple(message.names)
        named_once = len(set(axes)) == len(axes) and set(axes) <= set(AXES)
        if axes and named_once and len(message.position) == len(axes):
            self._buffer.add_reference(message.stamp, axes, message.position)

    def _on_point(self, message: PointStamped) -> None:
        p = message.point
        self._buffer.add_point(stamp_of(message.header), (p.x, p.y, p.z))

    def _on_alignment(self, message: TransformStamped) -> None:
        try:
            self._buffer.alignment = alignment_in(message)
        except StageError as error:
            self._failure = str(error)
            self.get_logger().error(self._failure)

    def _on_temperature(self, message: Temperature) -> None:
        self._buffer.temperatures.hear(
            message.header.frame_id, message.temperature, stamp_of(message.header), self.now()
        )

    def _fresh(self) -> dict[str, float]:
        """Temperatures of the sensors that are heard."""
        return self._buffer.temperatures.fresh(self.now(), self.value('temperature_timeout'))

    def _rates(self) -> dict[str, Rates]:
        """Derivatives of the temperatures that the model in use corrects by."""
        stored = self._correction.stored
        if stored is None or not stored.model.uses_derivatives:
            return {}
        return self._buffer.temperatures.rates(stored.sensors)

    def _retrain(self) -> Future[str]:
        try:
            job = self._job()
            training = self._trainer.start(job, Path(self._scratch.name) / 'job.json')
        except OSError as error:
            raise StageError(f'training failed: {error}') from error
        answer: Future[str] = Future()
        self.get_logger().info(f'training {job.method} for {job.out}')

        def finish(done: Future[str]) -> None:
            try:
                message = done.result()
                self._use(Path(job.out))
            except StageError as error:
                self._failure = str(error)
                answer.set_exception(error)
                return
            self._announce()
            answer.set_result(message)

        # The trainer's thread only hands over: the executor's owns model and adaptation.
        training.add_done_callback(lambda done: self.executor.create_task(finish, done))
        return answer

    def _job(self) -> Job:
        folder = Path(self.value('model_folder')).absolute()
        version = 1 + max([0, *(_version_of(path) for path in folder.glob('model_*.json'))])
        bag, live = self.value('bag'), ''
        if not bag:
            self._batches.take()
            live = str(Path(self._scratch.name) / 'live.npz')
            save_session(self._buffer.session(), Path(live))
        return Job(
            out=str(folder / f'model_{version:04d}.json'),
            bags=[bag] if bag else [],
            live=live,
            method=self.value('method'),
            options=_options(self.value('options')),
            source=self.value('input'),
            target=self.value('target'),
            machine=self.value('machine'),
            version=version,
            seed=self.value('seed'),
            max_correction=self.value('max_correction'),
        )

    def _use(self, path: Path) -> None:
        """Load a model and swap it in; on an error the old one stays."""
        stored = model_file.load(path, self.value('machine'))
        if self._correction.active and stored.refusal:
            raise StageError(f'{path} must not correct: {stored.refusal}')
        # One assignment: a target is corrected with the old model or with the new one.
        self._correction.stored = stored
        self._adaptation = None
        self._refusal = self._failure = ''
        self._file = str(path.absolute())

    def _adapt(self) -> None:
        self._batches.take()
        stored = self._correction.stored
        if not self.value('adapt') or stored is None or self._buffer.empty:
            return
        try:
            if self._adaptation is None:
                self._adaptation = LiveAdaptation(
                    stored,
                    self.value('adapt_drift'),
                    self.value('adapt_noise'),
                    self.value('adapt_forgetting'),
                )
            learned = self._adaptation.step(self._buffer)
            if self._failure.startswith(NO_ADAPTATION):
                self._failure = ''
            adapter = self._adaptation.adapter
            if not learned or (not adapter.proven and stored.model is adapter.trained):
                return
            adapted = Path(self.value('model_folder')).absolute() / 'adapted.json'
            taken = self._adaptation.stored
            model_file.save(taken, adapted)
        except StageError as error:
            self._failure = NO_ADAPTATION + str(error)
            return
        self._correction.stored = taken
        self._file = str(adapted)
        self._announce()

    def _announce(self) -> None:
        stored = self._correction.stored
        content = {
            'active': self._correction.active,
            'method': stored.model.method if stored else 'identity',
            'version': stored.version if stored else 0,
            'metrics': stored.metrics if stored else {},
            'file': self._file,
            'max_correction': self._correction.max_correction,
            'adapted_by': self._adaptation.adapter.learned if self._adaptation else 0,
        }
        self._models.publish(String(data=json.dumps(content)))

    def _on_activate(self, request: Any, response: Any) -> Any:
        try:
            self._correction.activate(bool(request.data))
        except StageError as error:
            response.success, response.message = False, str(error)
            return response
        self._refusal = ''
        self._announce()
        response.success = True
        response.message = 'correction active' if request.data else 'correction off'
        if silence := self._correction.silence(self._fresh()):
            response.message = f'{response.message}; {silence}'
        return response

    def _abort(self) -> str:
        if not self._trainer.abort():
            raise StageError('no training under way')
        return 'training aborted'

    def _load(self) -> str:
        if not self.value('model_file'):
            raise StageError('the parameter model_file is empty: name a model file')
        self._use(Path(self.value('model_file')))
        self._announce()
        assert self._correction.stored is not None
        return self._correction.stored.model.describe()

    def _status(self) -> tuple[bytes, str, dict[str, Any]]:
        stored = self._correction.stored
        values: dict[str, Any] = {
            'active': self._correction.active,
            'file': self._file,
            'largest correction [m]': self._correction.largest,
            'refused targets': self._refused,
            'training': self._trainer.progress if self._trainer.running else 'no',
            **self._buffer.counts(),
        }
        if self._adaptation:
            values['rests learned'] = self._adaptation.adapter.learned
            values['rests refused'] = self._adaptation.adapter.refused
            values['adaptation in use'] = self._adaptation.adapter.proven
            values['adaptations rolled back'] = self._adaptation.adapter.rollbacks
        if stored:
            values['held-out RMS [m]'] = stored.metrics.get('after', {}).get('rms')
        if refusal := self._correction.silence(self._fresh()) or self._refusal:
            return ERROR, refusal, values
        if trouble := self._failure or self._correction.beyond:
            return WARN, trouble, values
        return OK, stored.model.describe() if stored else 'no model', values


def _options(text: str) -> dict[str, Any]:
    return json_object(text or '{}', 'the parameter options', 'write {"degree": 7}, for example')


def _version_of(path: Path) -> int:
    digits = path.stem.removeprefix('model_')
    return int(digits) if digits.isdigit() else 0


def main() -> int:
    """Entry point of ``ros2 run calibrator calibrator``."""
    return run(Calibrator)


if __name__ == '__main__':
    sys.exit(main())
