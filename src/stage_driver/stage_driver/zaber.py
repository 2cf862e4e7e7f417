"""The Zaber backend: position moves, homing and bounded velocity streaming over Zaber ASCII.

A thread polls the positions, passes set-points on and watches flags. The protocol has no
watchdog against a dead host, so a velocity is sent as `move abs` to a point just ahead: whatever
happens to this process, the axis ends there.
"""

from __future__ import annotations

import contextlib
import threading
import time
from concurrent.futures import Future

from stage_core.clocks import NANOSECONDS
from stage_core.errors import StageError
from stage_driver.awaited_homing import AwaitedHoming
from stage_driver.backend import INFO, WARNING, Listener, Status
from stage_driver.config import ZaberConfig
from stage_driver.inbox_backend import InboxBackend
from stage_driver.limits import Setpoint
from stage_driver.states import Event, State
from stage_driver.zaber_clock import WallClock
from stage_driver.zaber_contact import ZaberContact
from stage_driver.zaber_link import AnswersLate, LinkLost, NoAnswer, advice, advised
from stage_driver.zaber_motion import ZaberMotion
from stage_driver.zaber_stage import Poll, ZaberStage, first_fault


class ZaberBackend(InboxBackend):
    """Owns the port's thread; everything else talks to it through the inbox."""

    def __init__(
        self, config: ZaberConfig, listener: Listener, clock: WallClock | None = None
    ) -> None:
        super().__init__(config, listener)
        self.config = config
        self._clock = clock or WallClock()
        self._stage: ZaberStage | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name='zaber', daemon=True)
        self._homing_deadline = 0.0
        self._motion = ZaberMotion()
        self._last: Poll | None = None
        self._second = -1
        self._flags: tuple[str, ...] | None = None
        self._warnings: tuple[str, ...] = ()
        self.counts.update(reconnections=0, missed_polls=0)
        self._awaited = AwaitedHoming(config.drive_timeout, f'port {config.port}', 'port')
        self._contact = ZaberContact(config, self._clock)

    # -- calls from other threads -------------------------------------------------------------

    def start(self) -> None:
        """Open the port, speak to every device, start the thread; StageError where that fails.

        A port that is not there yet is waited for in the thread.
        """
        stage = self._contact.first()
        if stage is None:
            self._listener.on_event(WARNING, f'waiting: {self._contact.absence}')
        else:
            self._found(stage)
        self._thread.start()

    def close(self) -> None:
        """Stop the axes, end the thread, give the knob back, close the port."""
        with contextlib.suppress(StageError):
            self.stop()
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)
        if self._stage is not None:
            self._stage.close()

    def stop(self) -> str:
        """Send `stop` to every axis now, in front of all queued requests.

        StageError where there is no contact: nobody may have heard it.
        """
        moving = self._states.state is State.MOVING
        self._ask_stop()
        heard = self._halt_devices()
        if not heard:
            raise StageError(self._contact.unheard)
        return 'stopping' if moving else 'at rest'

    def status(self) -> Status:
        """See `InboxBackend.status`."""
        stage = self._stage
        connected = stage is not None and not stage.link.lost
        details = self._details() | self._contact.details()
        state, reason = self._states.state, self._states.reason
        return Status(state, reason, self._homed, connected, details, self._warnings)

    # -- the thread ---------------------------------------------------------------------------

    def _run(self) -> None:
        period = 1.0 / self.config.rate
        due = time.monotonic()
        while not self._ended.is_set():
            try:
                self.serve()
                if self._stage is None:
                    self._reconnect()
                else:
                    self._step(self._stage)
            except AnswersLate as error:
                self.behind(str(error))
            except (LinkLost, NoAnswer) as error:
                self._lose(f'{advice(error)}, then call ~/reset_fault')
            except StageError as error:
                self._fail(str(error))
            except Exception as error:
                # Whatever it is, the stage must come to rest and somebody must hear of it.
                self._fail(f'internal error: {error!r}')
            due = max(due + period, time.monotonic())
            self._pause(due - time.monotonic())

    def _pause(self, seconds: float) -> None:
        """Wait for the next cycle."""
        self._ended.wait(seconds)

    def _step(self, stage: ZaberStage) -> None:
        """Poll every axis, then do what its state asks for."""
        poll = self._poll(stage)
        if poll is None:
            return
        self._watch_flags(stage, poll)
        self._progress(poll)
        # A controller in this process answers the poll before it is passed on.
        self.serve()
        self._follow_stream(stage, poll)
        self._publish(stage, poll)

    def _poll(self, stage: ZaberStage) -> Poll | None:
        poll = stage.poll()
        self.counts['missed_polls'] += poll is None
        if poll is not None:
            self._listener.on_measured(poll.stamp, stage.metres(poll.steps))
        return poll

    def _watch_flags(self, stage: ZaberStage, poll: Poll) -> None:
        """Read the list of warnings when a flag changes; faults latch, WR asks for homing."""
        if poll.flags == self._flags:
            return
        self._warnings = () if set(poll.flags) == {'--'} else stage.warnings()
        self._flags = poll.flags
        if 'WR' in self._warnings:
            if self._homed:
                self._listener.on_event(WARNING, 'the stage lost its position: home with ~/home')
                self._homed = False
            if self._states.state is State.MOVING and self._homing is None:
                self._fail('an axis lost its position while it moved; home with ~/home')
        # A driver that was disabled on request is no fault.
        disabled = self._states.state is State.DISABLED
        self._fail_if(first_fault(self._warnings, ('FO', 'FD') if disabled else ()))

    def _progress(self, poll: Poll) -> None:
        """Find the end of homing and of position moves."""
        if self._states.state is not State.MOVING or self._streaming:
            return
        if not self._at_rest(poll):
            if self._homing is not None and self._clock.elapsed() > self._homing_deadline:
                self._fail(f'homing took longer than {self.config.homing_timeout} s')
            return
        if self._homing is not None:
            self._finish_homing()
        elif self._motion.missed(poll):
            shown = ', '.join(flag for flag in poll.flags if flag != '--') or 'no flag'
            self._listener.on_event(WARNING, f'a move ended before its target ({shown})')
        self._motion.targets = None
        self._states.handle(Event.DONE)

    def _at_rest(self, poll: Poll) -> bool:
        """Whether a motion has come to its end."""
        return not any(poll.busy)

    def _finish_homing(self) -> None:
        homing, self._homing = self._homing, None
        self._homed = 'WR' not in self._warnings
        if homing is not None and self._homed:
            self._motion.references = [0.0] * len(self.config.axes)
            homing.set_result('homed: ' + ', '.join(self.config.axes))
        elif homing is not None:
            homing.set_exception(StageError('homing ended without a reference: see /diagnostics'))

    def _follow_stream(self, stage: ZaberStage, poll: Poll) -> None:
        """Pass the newest set-point's velocities on, or stop when it is too old."""
        if self._streaming and self._motion.age() > self.config.setpoint_timeout:
            self.watchdog(f'no set-point for {self.config.setpoint_timeout} s')
        else:
            self._fail_if(self._motion.send(stage, poll))

    def _publish(self, stage: ZaberStage, poll: Poll) -> None:
        """Publish the cycle; a stepper's velocity is the difference of its positions."""
        positions = stage.metres(poll.steps)
        velocities = stage.velocities(self._last, poll)
        self._last = poll
        references, rates = self._motion.told(positions)
        self._listener.on_state(poll.stamp, positions, velocities)
        self._listener.on_control(poll.stamp, references, rates, rates, ())
        self._read_temperatures(stage, poll.stamp)

    def _read_temperatures(self, stage: ZaberStage, stamp: int) -> None:
        """Ask for the temperatures once a second."""
        second = stamp // NANOSECONDS
        if second != self._second:
            self._second = second
            found = stage.temperatures()
            self._listener.on_temperatures(stamp, list(found), list(found.values()))

    # -- requests, in the thread --------------------------------------------------------------

    def _refusal(self, setpoint: Setpoint) -> str | None:
        refused = super()._refusal(setpoint)
        return refused or (None if self._last is not None else 'no position is known yet')

    def _take(self, setpoint: Setpoint) -> None:
        self._states.handle(Event.MOVE)
        if self._stage is not None and self._last is not None:
            self._fail_if(self._motion.take(self._stage, setpoint, self._last))

    def _start_homing(self, done: Future[str]) -> None:
        # A stage that was never met yet is enabled when it comes.
        coming = not self._contact.met and self._homing is None and self._enables_itself
        refused = None if coming else self._move_refusal(self._contact_refusal())
        if refused is None and self._streaming:
            refused = 'a stream is being followed: end it first'
        if refused is not None:
            done.set_exception(StageError(refused))
            return
        self._homing = done
        if coming:
            self._listener.on_event(INFO, self._awaited.ask())
        else:
            self._begin_homing(self._present())

    def _begin_homing(self, stage: ZaberStage) -> None:
        self._motion.end()
        self._homing_deadline = self._clock.elapsed() + self.config.homing_timeout
        self._states.handle(Event.MOVE)
        self._fail_if(stage.home())

    def _contact_refusal(self) -> str | None:
        return None if self._stage is not None else self._contact.lost

    def _halt(self) -> None:
        self._motion.end()
        # Wherever it comes to rest: the last poll is from before the braking.
        self._motion.references = []
        self._halt_devices()

    def _halt_devices(self) -> bool:
        """Send `stop` to whoever hears it; whether there is contact."""
        link = self._contact.link
        return link is not None and link.stop() and self._stage is not None

    @property
    def _streaming(self) -> bool:
        return self._motion.stream is not None

    def _reset(self) -> str:
        """Clear the devices' warnings; the fault stays as long as its cause."""
        stage = self._present()
        with advised():
            fault = first_fault(stage.warnings(clear=True), ('FO', 'FD'))
        if fault is not None:
            raise StageError(f'the fault stays: {fault}')
        self._flags = None
        state = self._states.handle(Event.RESET)
        if self._enables_itself and state is State.DISABLED:
            return self._switch(True)
        return state.value

    def _switch(self, on: bool) -> str:
        stage = self._present()
        state = self._states.handle(Event.ENABLE if on else Event.DISABLE)
        if not on:
            self._stop('disabled')
        with advised():
            stage.switch_drivers(on)
        self._flags = None
        return state.value

    def _present(self) -> ZaberStage:
        if self._stage is None:
            raise StageError(self._contact.lost)
        return self._stage

    def _fail(self, reason: str) -> None:
        self._states.handle(Event.FAIL, reason)
        self._stop(reason)

    def _fail_if(self, reason: str | None) -> None:
        if reason is not None:
            self._fail(reason)

    # -- the wire -----------------------------------------------------------------------------

    def _found(self, stage: ZaberStage) -> bool:
        """Take a stage; whether it is the first time."""
        self._warnings = stage.warnings()
        self._homed = 'WR' not in self._warnings
        self._flags = self._last = None
        self._last_setpoint = self._last_streamed = None
        self._motion.references = []
        # Narrowed to the devices' own travel.
        self._limits = stage.limits
        self._stage = stage
        first = self._contact.found()
        if first and self._enables_itself and self._states.state is State.DISABLED:
            self._states.handle(Event.ENABLE)
        return first

    def _lose(self, reason: str) -> None:
        # One silent device ends the contact: the others must not run on.
        self._halt_devices()
        stage, self._stage = self._stage, None
        if stage is not None:
            stage.link.close()
        self._fail(reason)

    def _reconnect(self) -> None:
        """Look for the devices; found ones are stopped and asked whether they know their place."""
        if self._awaited.waiting and (reason := self._awaited.given_up()):
            self._awaited.end()
            self._stop(reason)
        stage = self._contact.look()
        if stage is None:
            return
        try:
            first = self._found(stage)
        except (NoAnswer, LinkLost):
            stage.link.close()
            return
        known = 'the position is known' if self._homed else 'the position is lost: call ~/home'
        self._listener.on_event(
            INFO, f'{self.config.port} is {"there" if first else "back"}, {known}'
        )
        self.counts['reconnections'] += not first
        self._end_waiting(stage)

    def _end_waiting(self, stage: ZaberStage) -> None:
        """Begin the homing that was asked for before the stage was there."""
        self._awaited.end()
        if self._homing is not None and (refused := self._states.refusal(Event.MOVE)):
            self._stop(refused)
        elif self._homing is not None:
            self._begin_homing(stage)
