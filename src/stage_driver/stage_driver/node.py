"""The stage driver's node: parameters, topics and services around a backend."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Sequence
from typing import Any

from sensor_msgs.msg import JointState, Temperature
from std_srvs.srv import SetBool, Trigger

from stage_core import topics
from stage_core.ros.joint_state_wire import JointSample, JointStateLayout
from stage_core.ros.node import (
    ERROR,
    OK,
    SETPOINT_QOS,
    STATE_QOS,
    WARN,
    JointStateReader,
    StageNode,
    first_time,
    run,
    set_stamp,
)
from stage_core.ros.services_node import create_deferred_service, create_trigger_service
from stage_driver.backend import FAILURE, WARNING, Controller
from stage_driver.driver_parameters import PARAMETERS, axes_of, servo_config, zaber_config
from stage_driver.inbox_backend import InboxBackend
from stage_driver.servo import ServoBackend
from stage_driver.states import State
from stage_driver.zaber import ZaberBackend
from stage_driver.zaber_lockstep import LockstepZaberBackend
from stage_driver.zaber_words import describe_flag

#: The servo thread must get the interpreter within a fraction of a tick [s], also while set-points
#: flood the executor's thread; with Python's own 5 ms the velocity loop is unstable then.
SWITCH_INTERVAL = 2e-4
#: Own set-points that may still come back: more than the executor can ever lag behind.
OWN_KEPT = 4096
#: The same refusal at the stream's rate is one line of the log in this time [s].
LOG_PERIOD = 5.0
#: Events that /diagnostics tell at once, each of them at most this often [s].
TOLD_AT_ONCE, TELL_PERIOD = ('set-point refused', 'stop: '), 0.1


class StageDriver(StageNode):
    """Publishes what the backend measures and commands, hands set-points and requests to it."""

    def __init__(self) -> None:
        super().__init__('stage_driver', PARAMETERS)
        axes = self.axes = axes_of(self.value)
        count = len(axes)
        # Three topics at 1 kHz leave no time for a message object each.
        self._moving = JointStateLayout(topics.STAGE_FRAME, axes, (count, count, 0))
        self._command = {
            forces: JointStateLayout(topics.STAGE_FRAME, axes, (0, count, forces))
            for forces in (0, count)
        }
        self._reader = JointStateReader()
        self._reference_out = self.create_publisher(JointState, topics.REFERENCE, STATE_QOS)
        self._command_out = self.create_publisher(JointState, topics.COMMAND, STATE_QOS)
        self._measured_out = self.create_publisher(JointState, topics.JOINT_STATES, STATE_QOS)
        self._temperature_out = self.create_publisher(Temperature, topics.TEMPERATURE, STATE_QOS)
        self._temperature = Temperature()
        self._log_lock = threading.Lock()
        self._logged: dict[str, float] = {}
        self._refused_at = -1e9
        self._told = dict.fromkeys(TOLD_AT_ONCE, -1e9)
        self._rivals = 0
        self._controller: Controller | None = None
        #: Set-points of the controller in this process, which come back by the topic.
        self._own: dict[bytes, None] = {}
        self._own_lock = threading.Lock()
        self._backend = self._make_backend()
        self.create_subscription(
            JointState, topics.SETPOINT, self._on_setpoint, SETPOINT_QOS, raw=True
        )
        create_deferred_service(self, Trigger, '~/home', lambda _: self._backend.home())
        create_deferred_service(
            self, Trigger, '~/reset_fault', lambda _: self._backend.reset_fault()
        )
        create_deferred_service(
            self, SetBool, '~/enable', lambda request: self._backend.enable(request.data)
        )
        create_trigger_service(self, '~/stop', lambda: self._backend.stop())
        self.diagnostics.task('state', self._state_status)
        self.diagnostics.task('set-points', self._setpoint_status)
        sys.setswitchinterval(SWITCH_INTERVAL)
        self._backend.start()

    def shutdown(self) -> None:
        """Bring the stage to rest and close the wire."""
        self._backend.close()

    def _make_backend(self) -> InboxBackend:
        if self.value('backend') == 'zaber':
            config = zaber_config(self.value)
            if self.value('use_sim_time'):
                return LockstepZaberBackend(config, self, first_time(self))
            return ZaberBackend(config, self)
        return ServoBackend(servo_config(self.value), self)

    # -- a controller in this process ---------------------------------------------------------

    def join(self, controller: Controller) -> None:
        """Hand every measurement to a controller of this process from now on."""
        self._controller = controller

    def take(self, sample: JointSample, data: bytes) -> None:
        """Take a set-point of the controller; `data` is what it publishes of it."""
        with self._own_lock:
            self._own[data] = None
            if len(self._own) > OWN_KEPT:
                del self._own[next(iter(self._own))]
        self._backend.submit(*sample[:4])

    # -- requests -----------------------------------------------------------------------------

    def _on_setpoint(self, data: bytes) -> None:
        if self._own:
            with self._own_lock:
                if data in self._own:
                    return
        message = self._reader.read(data)
        if message is not None:
            self._backend.submit(*message[:4])

    # -- the backend's listener, called in its thread -----------------------------------------

    def on_measured(self, stamp: int, positions: Sequence[float]) -> None:
        """Let the controller of this process answer."""
        if self._controller is not None:
            self._controller.measured(stamp, positions)

    def on_state(
        self, stamp: int, positions: Sequence[float], velocities: Sequence[float]
    ) -> None:
        """Publish /stage/joint_states."""
        self._measured_out.publish(self._moving.encode(stamp, positions, velocities))
        if self._controller is not None:
            self._controller.told()

    def on_control(
        self,
        stamp: int,
        references: Sequence[float],
        rates: Sequence[float],
        commands: Sequence[float],
        forces: Sequence[float],
    ) -> None:
        """Publish /stage/reference and /stage/command."""
        self._reference_out.publish(self._moving.encode(stamp, references, rates))
        command = self._command[len(forces)]
        self._command_out.publish(command.encode(stamp, (), commands, forces))

    def on_temperatures(self, stamp: int, sensors: Sequence[str], values: Sequence[float]) -> None:
        """Publish /stage/temperature, one message per sensor."""
        message = self._temperature
        set_stamp(message.header, stamp)
        for sensor, value in zip(sensors, values, strict=False):
            message.header.frame_id = sensor
            message.temperature = value
            self._temperature_out.publish(message)

    def on_event(self, level: int, text: str) -> None:
        """Log an event; the same kind of line at most once in LOG_PERIOD."""
        now = time.monotonic()
        kind = text[:40]
        with self._log_lock:
            if text.startswith('set-point refused'):
                self._refused_at = now
            for known in TOLD_AT_ONCE:
                if text.startswith(known):
                    self._tell(known, now)
            if now - self._logged.get(kind, -1e9) < LOG_PERIOD:
                return
            if len(self._logged) > 100:
                self._logged.clear()
            self._logged[kind] = now
        log = self.get_logger()
        if level == FAILURE:
            log.error(text)
        elif level == WARNING:
            log.warning(text)
        else:
            log.info(text)

    def _tell(self, known: str, now: float) -> None:
        """Speak on /diagnostics: a controller learns it now, not with the next heartbeat.

        Another thread does it, as the backend's has a tick to answer.
        """
        told = self._told[known]
        if now < told:  # what is about to be told holds this one, too
            return
        self._told[known] = max(now, told + TELL_PERIOD)
        telling = threading.Timer(self._told[known] - now, self.diagnostics.publish)
        telling.daemon = True
        telling.start()

    # -- diagnostics --------------------------------------------------------------------------

    def _state_status(self) -> tuple[bytes, str, dict[str, Any]]:
        status = self._backend.status()
        values = {
            'state': status.state.value,
            'homed': status.homed,
            'connected': status.connected,
            'scheduling': self.scheduling,
            **status.details,
        }
        for flag in status.warnings:
            values[f'warning {flag}'] = describe_flag(flag)
        if status.state is State.FAULT:
            return ERROR, f'fault: {status.reason}', values
        if not status.connected:
            return ERROR, f'no contact with the stage: {status.details.get("waits", "")}', values
        if status.state is State.DISABLED:
            return WARN, 'disabled: call ~/enable with data true', values
        if not status.homed:
            return WARN, 'not homed: call ~/home', values
        # Notes, such as that a stop interrupted a move, are no warnings.
        serious = [flag for flag in status.warnings if not flag.startswith('N')]
        if serious:
            return WARN, '; '.join(describe_flag(flag) for flag in serious), values
        return OK, status.state.value, values

    def _setpoint_status(self) -> tuple[bytes, str, dict[str, Any]]:
        details = self._backend.status().details
        shown = (
            'refused',
            'last_refusal',
            'refused_stamp',
            'rival_setpoints',
            'stops',
            'last_stop',
        )
        values = {name: details.get(name, '') for name in shown}
        # Once a second: a name per publisher, also of a node that only could publish.
        publishers = self.get_publishers_info_by_topic(topics.SETPOINT)
        names = ', '.join(sorted(publisher.node_name for publisher in publishers))
        values['publishers'] = names
        before, self._rivals = self._rivals, int(details['rival_setpoints'])
        if self._rivals > before and len(publishers) > 1:
            text = f'more than one controller streams set-points: end all but one of {names}'
            self.on_event(WARNING, text)
            return WARN, text, values
        if time.monotonic() - self._refused_at < 2.0 * LOG_PERIOD:
            return WARN, values['last_refusal'], values
        return OK, 'no set-point refused of late', values


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(StageDriver, args)


if __name__ == '__main__':
    raise SystemExit(main())
