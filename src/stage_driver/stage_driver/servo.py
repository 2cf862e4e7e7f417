"""The servo backend: a thread that closes the velocity loop over the drive link, tick by tick.

Real time: every encoder datagram is answered at once with the newest set-point. Lockstep: virtual
time stands still until a force is sent; it is sent while a move, homing or a stop is executed,
and in a stream only for a tick whose set-point has come. Otherwise the world is quiet.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Sequence
from concurrent.futures import Future

from stage_core import drive_link
from stage_core.errors import StageError
from stage_driver.backend import INFO, WARNING, Listener, Status
from stage_driver.drive_socket import DriveSocket
from stage_driver.inbox_backend import InboxBackend
from stage_driver.limits import AxisLimits, Setpoint
from stage_driver.servo_axes import ServoAxes, ServoConfig
from stage_driver.servo_waits import AwaitedHoming, Lateness
from stage_driver.states import Event, State

SECOND = 1_000_000_000
#: Stage time after which braking under control gives way to the drive's own brake [s].
BRAKE_TIMEOUT = 2.0
#: Longest wait for rest when the driver shuts down [s].
CLOSE_TIMEOUT = 2.0


class ServoBackend(InboxBackend):
    """Owns the loop's thread; everything else talks to it through the inbox."""

    def __init__(
        self, config: ServoConfig, listener: Listener, link: DriveSocket | None = None
    ) -> None:
        super().__init__(config.axes, listener)
        self.config = config
        self._axes = ServoAxes(config)
        self.motion = self._axes.motion
        self._link = link or DriveSocket(config.host, config.port)
        self._drive = f'{config.host}:{config.port}'
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name='servo_loop', daemon=True)
        self._homed = not config.home_required
        self._tick = -1
        self._stamp = 0
        self._answered = -1
        self._stream_stamp = -1
        self._stream_age = 0
        self._last_second = -1
        self._last_packet = b''
        #: The newest measurement while it is not published.
        self._untold: drive_link.Datagram | None = None
        self._braking = False
        self._brake_ticks = 0
        self._awaited = AwaitedHoming(
            config.drive_timeout, f'drive at {self._drive}', 'drive_host and drive_port'
        )
        self._late = Lateness(self._axes.period)
        self._counts.update(missed_ticks=0, late_ticks=0, late_setpoints=0)

    # -- calls from other threads -------------------------------------------------------------

    def start(self) -> None:
        """Start the thread; the drive may come later."""
        self._thread.start()

    def close(self) -> None:
        """Stop in a controlled way, then end the thread."""
        if self._thread.is_alive():
            self._inbox.put(lambda: self._stop('the driver shuts down'))
            deadline = time.monotonic() + CLOSE_TIMEOUT
            while self._link.connected and time.monotonic() < deadline and not self._is_quiet():
                time.sleep(0.005)
            self._ended.set()
            self._thread.join(timeout=5.0)
        self._link.close()

    def stop(self) -> str:
        """See `Backend.stop`."""
        self._inbox.put(lambda: self._stop('stopped by request'))
        return 'stopping' if self._states.state is State.MOVING else 'at rest'

    def status(self) -> Status:
        """See `Backend.status`."""
        details = self._details()
        details['mode'] = self.motion.mode.value
        details['clamped_velocities'] = str(self.motion.clamped)
        details['tick'] = str(self._tick)
        details['drive'] = self._drive
        details['clock'] = 'lockstep' if self._link.lockstep else 'real'
        if missing := self._contact_refusal():
            details['waits'] = missing
        return Status(
            self._states.state, self._states.reason, self._homed, self._link.connected, details
        )

    # -- the thread ---------------------------------------------------------------------------

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                self._step()
            except Exception as error:
                # Whatever it is, the stage must come to rest and somebody must hear of it.
                self._fail(f'internal error: {error!r}')

    def _step(self) -> None:
        """Serve one encoder datagram, or the silence in its place."""
        datagram = self._link.receive(0.05)
        if datagram is not None:
            self._on_encoder(datagram)
            return
        self._drain()
        self._begin_awaited_homing()
        silent, config = self._link.silence(), self.config
        longest = config.lockstep_timeout if self._link.lockstep else config.link_timeout
        if self._link.connected and silent > longest:
            self._lost(silent)

    def _lost(self, silent: float) -> None:
        self._link.connected = False
        self._fail(
            f'no encoder datagram from the drive at {self._drive} for {silent:.1f} s: '
            'is it running?'
        )
        self.motion.hold(self._axes.encoder)
        self._braking = False

    def _on_encoder(self, datagram: drive_link.Datagram) -> None:
        if len(datagram.values) != len(self.config.axes):
            self._fail(
                f'the drive has {len(datagram.values)} axes, the driver '
                f'{len(self.config.axes)}: give both the same twin file'
            )
            return
        restarted = bool(datagram.flags & drive_link.RESET) or datagram.tick < self._tick
        repeated = datagram.tick == self._tick and not restarted
        if repeated and self._link.connected:
            if self._answered == datagram.tick:
                self._link.send(self._last_packet)
            return
        passed = 1
        if self._tick < 0 or restarted or not self._link.connected:
            self._contact(datagram, restarted)
            self._late.clear()
        elif not repeated:
            passed = datagram.tick - self._tick
            if passed > 1:
                self._counts['missed_ticks'] += passed - 1
                self._late.add(passed - 1, not self.motion.at_rest)
        self._tick, self._stamp = datagram.tick, datagram.stamp
        if not repeated:
            self._axes.measure(datagram.values, passed)
            self._untold = datagram
            self._listener.on_measured(self._stamp, self._axes.encoder.tolist())
        if self._link.lockstep:
            # Its set-point is awaited; in real time the force goes first, which the plant awaits.
            self._tell_state()
        over = not self._link.lockstep and self._link.newer_waits()
        if over:
            self._counts['late_ticks'] += 1
            self._late.add(1, not self.motion.at_rest)
        self._drain()
        if over:
            self._tell_state()
            self._let_pass()
            return
        self._begin_awaited_homing()
        if self._link.lockstep:
            self._wait_in_lockstep()
            return
        self._end_if_late()
        if self._controlling():
            self._watch_stream()
            self._control()
        self._tell_state()

    def _let_pass(self) -> None:
        """A tick that is over: a force for it would come late; its reference goes by."""
        if self._controlling() and not self._late.lost:
            self._watch_stream()
            if self._axes.control():
                self._finished()

    def _end_if_late(self) -> None:
        """Up to date again: a motion that the drive has braked meanwhile is ended."""
        late = self._late.clear()
        if not late or self.motion.at_rest:
            return
        reason = f'the driver was late by {late * 1e3:.0f} ms: lower the load of this machine'
        self._listener.on_event(WARNING, f'motion ended, the stage stops: {reason}')
        self._stop(reason)
        self.motion.stop_from(self._axes.encoder, self._axes.velocity)

    def _tell_state(self) -> None:
        """Publish what was measured, once; temperatures once a second."""
        datagram, self._untold = self._untold, None
        if datagram is None:
            return
        self._listener.on_state(
            self._stamp, self._axes.encoder.tolist(), self._axes.velocity.tolist()
        )
        second = self._stamp // SECOND
        if second != self._last_second and datagram.temperatures:
            self._last_second = second
            self._listener.on_temperatures(self._stamp, drive_link.SENSORS, datagram.temperatures)

    def _contact(self, datagram: drive_link.Datagram, restarted: bool) -> None:
        """First encoder of a drive, or the first after it was lost or reset."""
        first = self._tick < 0
        moving = not self.motion.at_rest
        self._axes.begin(datagram.values)
        self._answered = self._stream_stamp = -1
        self._last_setpoint = self._last_streamed = None
        self._link.connected = True
        self._braking = False
        if self._link.lockstep and datagram.tick > 0 and not restarted:
            # Virtual time stood still while nobody drove: the stage may be in full motion.
            self.motion.come_to_rest(self._axes.encoder)
            self._braking, self._brake_ticks = True, round(BRAKE_TIMEOUT / self._axes.period)
        if not first and not restarted:
            self._listener.on_event(INFO, f'drive back at tick {datagram.tick}')
            return
        if not first:
            self._homed = not self.config.home_required
            self._listener.on_event(WARNING, 'the drive was restarted: home with ~/home')
            if moving or self._states.state is State.MOVING:
                self._abandon('the drive was restarted during a motion')
            return
        self._listener.on_event(INFO, f'drive found at tick {datagram.tick}')
        if self._enables_itself and self._states.state is State.DISABLED:
            self._states.handle(Event.ENABLE)

    def _wait_in_lockstep(self) -> None:
        """Answer this tick as soon as it is due; until then requests are served."""
        waiting_since = time.monotonic()
        while not self._ended.is_set():
            if self._due():
                self._control()
                return
            try:
                self._inbox.get(timeout=0.05)()
            except queue.Empty:
                if self._link.peek_reset():
                    return
                # A drive that waits repeats its tick several times a second.
                silent = self._link.silence()
                if silent > self.config.lockstep_timeout:
                    self._lost(silent)
                    return
                waited = time.monotonic() - waiting_since
                if self.motion.streaming and waited > self.config.lockstep_timeout:
                    self._watchdog(f'no set-point for tick {self._tick} in {waited:.0f} s')

    def _due(self) -> bool:
        if not self._controlling() or self.motion.at_rest:
            return False
        return not self.motion.streaming or self._stream_stamp == self._stamp

    def _controlling(self) -> bool:
        return self._states.state in (State.READY, State.MOVING) or self._braking

    def _control(self) -> None:
        """One control tick: reference, velocity command, force; sent before all is published."""
        axes = self._axes
        done = axes.control()
        self._last_packet = drive_link.encode_force(
            self._tick, self._stamp, tuple(axes.force.tolist())
        )
        self._answered = self._tick
        self._link.send(self._last_packet)
        self._tell_state()
        self._listener.on_control(
            self._stamp,
            self.motion.reference.tolist(),
            self.motion.speed.tolist(),
            axes.command.tolist(),
            axes.force.tolist(),
        )
        if done:
            self._finished()
        elif (fault := axes.following_fault()) is not None and not self._braking:
            self._fail(fault)
        if self._braking:
            self._brake_ticks -= 1
            if self.motion.at_rest or self._brake_ticks <= 0:
                self._braking = False
                self.motion.hold(self._axes.encoder)

    def _watch_stream(self) -> None:
        """Real time: bring the stage to rest when the stream's set-points stop coming."""
        if not self.motion.streaming:
            return
        self._stream_age += 1
        # One tick is the way through another process.
        self._counts['late_setpoints'] += self._stream_age > 2
        if self._stream_age * self._axes.period > self.config.setpoint_timeout:
            self._watchdog(f'no set-point for {self.config.setpoint_timeout} s')

    # -- requests, in the thread --------------------------------------------------------------

    def _take(self, setpoint: Setpoint) -> None:
        if self._repeats(setpoint):
            return
        refused = self._move_refusal(self._contact_refusal())
        if refused is None and not self._homed:
            refused = 'the stage is not homed: call ~/home first'
        if refused is not None:
            self._refuse(f'set-point refused: {refused}', setpoint.stamp)
            return
        if self._link.lockstep and setpoint.streams and setpoint.stamp != self._stamp:
            self._counts['late_setpoints'] += 1
            self._refuse(
                f'set-point refused: stamped {setpoint.stamp} ns while tick {self._tick} of '
                f'{self._stamp} ns waits: stamp it as the newest /stage/joint_states',
                setpoint.stamp,
            )
            return
        self._last_setpoint = setpoint
        if setpoint.streams:
            self._stream_stamp, self._stream_age = setpoint.stamp, 0
        self.motion.take(setpoint, self._axes.encoder)
        self._states.handle(Event.MOVE)

    def _start_homing(self, done: Future[str]) -> None:
        # A drive that was never met yet enables the stage when it comes.
        coming = self._tick < 0 and self._enables_itself
        coming = coming and self._homing is None and self._states.state is State.DISABLED
        refused = None if coming else self._move_refusal(None)
        if refused is None and self.motion.streaming:
            refused = 'a stream is being followed: end it first'
        if refused is not None:
            done.set_exception(StageError(refused))
            return
        self._homing = done
        patience = self._awaited.ask()
        if not self._link.connected:
            self._listener.on_event(INFO, patience)
        self._begin_awaited_homing()

    def _begin_awaited_homing(self) -> None:
        """Home once the drive is there and what brakes has come to rest, or give up."""
        if not self._awaited.waiting:
            return
        if self._homing is None:
            self._awaited.end()
        elif not self._link.connected:
            if reason := self._awaited.given_up():
                self._stop(reason)
        elif not self._braking:
            self._awaited.end()
            self._axes.home(self.config.homing_velocity)
            self._states.handle(Event.MOVE)

    def _finished(self) -> None:
        """A motion has come to its end and its dwell is over."""
        if self._states.state is State.MOVING:
            self._states.handle(Event.DONE)
        if self._homing is not None and not self._awaited.waiting:
            self._homed = True
            homing, self._homing = self._homing, None
            homing.set_result(f'homed: {self._axes.where()}')

    def _contact_refusal(self) -> str | None:
        if self._link.connected:
            return None
        return f'no drive at {self._drive}: start it'

    def _halt(self) -> None:
        self.motion.stop(self._axes.encoder)

    @property
    def _streaming(self) -> bool:
        return self.motion.streaming

    @property
    def _enables_itself(self) -> bool:
        return self.config.enable_on_start and not self._kept_disabled

    def _limits(self) -> Sequence[AxisLimits]:
        return self.config.limits

    def _switch(self, on: bool) -> str:
        state = self._states.handle(Event.ENABLE if on else Event.DISABLE)
        if not on:
            self._brake('disabled')
        elif self.motion.at_rest:
            self._axes.hold_here()
        return state.value

    def _reset(self) -> str:
        """Clear the fault; enable again where the stage does so at the start."""
        state = self._states.handle(Event.RESET)
        if state is State.DISABLED and self._enables_itself and self._link.connected:
            return self._switch(True)
        return state.value

    def _fail(self, reason: str) -> None:
        self._states.handle(Event.FAIL, reason)
        self._brake(reason)

    def _brake(self, reason: str) -> None:
        """Stop under control although the state no longer allows motion."""
        if not self.motion.at_rest and not self._braking:
            self._braking, self._brake_ticks = True, round(BRAKE_TIMEOUT / self._axes.period)
        self._stop(reason)

    def _abandon(self, reason: str) -> None:
        """A motion whose stage is gone: nothing to brake."""
        self._stop(reason)
        self.motion.hold(self._axes.encoder)
        if self._states.state is State.MOVING:
            self._states.handle(Event.DONE)

    def _is_quiet(self) -> bool:
        return self.motion.at_rest and self._inbox.empty()
