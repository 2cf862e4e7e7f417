"""The servo backend: a thread that closes the velocity loop over the drive link, tick by tick.

What a tick waits for before its force is sent: `servo_clocks`.
"""

from __future__ import annotations

import threading
import time
from concurrent.futures import Future

from stage_core import drive_link
from stage_core.errors import StageError
from stage_driver.awaited_homing import AwaitedHoming
from stage_driver.backend import INFO, WARNING, Listener, Status
from stage_driver.config import ServoConfig
from stage_driver.drive_socket import DriveSocket
from stage_driver.inbox_backend import InboxBackend
from stage_driver.limits import Setpoint
from stage_driver.servo_axes import ServoAxes
from stage_driver.servo_clocks import Clock, Lockstep, RealTime
from stage_driver.servo_news import News
from stage_driver.states import Event, State

#: Stage time after which braking under control gives way to the drive's own brake [s].
BRAKE_TIMEOUT = 2.0
#: Longest wait for rest when the driver shuts down [s].
CLOSE_TIMEOUT = 2.0


class ServoBackend(InboxBackend):
    """Owns the loop's thread; everything else talks to it through the inbox."""

    def __init__(
        self, config: ServoConfig, listener: Listener, link: DriveSocket | None = None
    ) -> None:
        super().__init__(config, listener)
        self.config = config
        self.axes = ServoAxes(config)
        self.motion = self.axes.motion
        self.link = link or DriveSocket(config.drive_host, config.drive_port)
        self.ended = threading.Event()
        self._drive = f'{config.drive_host}:{config.drive_port}'
        self._thread = threading.Thread(target=self._run, name='servo_loop', daemon=True)
        self._clock: Clock = RealTime(self)
        self._homed = not config.home_required
        #: Number and stamp [ns] of the newest tick, and the one that has had its force.
        self.tick, self.stamp, self._answered = -1, 0, -1
        self._last_packet = b''
        self._news = News(self.axes, listener)
        self._brake_ticks = 0
        self._awaited = AwaitedHoming(
            config.drive_timeout, f'drive at {self._drive}', 'drive_host and drive_port'
        )
        self.counts.update(missed_ticks=0, late_ticks=0, late_setpoints=0)

    # -- calls from other threads -------------------------------------------------------------

    def start(self) -> None:
        """Start the thread; the drive may come later."""
        self._thread.start()

    def close(self) -> None:
        """Stop in a controlled way, then end the thread."""
        if self._thread.is_alive():
            self._inbox.put(lambda: self._stop('the driver shuts down'))
            deadline = time.monotonic() + CLOSE_TIMEOUT
            while self.link.connected and time.monotonic() < deadline and not self._is_quiet():
                time.sleep(0.005)
            self.ended.set()
            self._thread.join(timeout=5.0)
        self.link.close()

    def stop(self) -> str:
        """See `InboxBackend.stop`."""
        self._ask_stop()
        return 'stopping' if self._states.state is State.MOVING else 'at rest'

    def status(self) -> Status:
        """See `InboxBackend.status`."""
        details = self._details()
        details['mode'] = self.motion.mode.value
        details['clamped_velocities'] = str(self.motion.clamped)
        details['tick'] = str(self.tick)
        details['drive'] = self._drive
        details['clock'] = self._clock.name
        if missing := self._contact_refusal():
            details['waits'] = missing
        return Status(
            self._states.state, self._states.reason, self._homed, self.link.connected, details
        )

    # -- the thread ---------------------------------------------------------------------------

    def _run(self) -> None:
        while not self.ended.is_set():
            try:
                self._step()
            except Exception as error:
                # Whatever it is, the stage must come to rest and somebody must hear of it.
                self._fail(f'internal error: {error!r}')

    def _step(self) -> None:
        """Serve one encoder datagram, or the silence in its place."""
        datagram = self.link.receive(0.05)
        if datagram is not None:
            self._on_encoder(datagram)
            return
        self.serve()
        self.begin_awaited_homing()
        if self.link.connected and self.link.silence() > self._clock.patience:
            self.lose()

    def _on_encoder(self, datagram: drive_link.Datagram) -> None:
        """One tick: measure, compute and send the force as the clock says, tell."""
        if len(datagram.values) != len(self.config.axes):
            self._fail(
                f'the drive has {len(datagram.values)} axes, the driver '
                f'{len(self.config.axes)}: give both the same twin file'
            )
            return
        restarted = bool(datagram.flags & drive_link.RESET) or datagram.tick < self.tick
        repeated = datagram.tick == self.tick and not restarted
        if repeated and self.link.connected:
            if self._answered == datagram.tick:
                self.link.send(self._last_packet)
            return
        passed = 1
        if self.tick < 0 or restarted or not self.link.connected:
            self._contact(datagram, restarted)
        else:
            passed = datagram.tick - self.tick
            self._count_missed(passed - 1)
        self.tick, self.stamp = datagram.tick, datagram.stamp
        if not repeated:
            self.axes.measure(datagram.values, passed)
            self._news.measured(datagram)
        if self._clock.waits:
            self._news.tell()
        ended = self._clock.answer()
        self._news.tell()
        if ended is not None:
            self._conclude(ended)

    def _count_missed(self, ticks: int) -> None:
        if ticks:
            self.counts['missed_ticks'] += ticks
            self._clock.missed(ticks)

    def control(self) -> bool:
        """Reference, velocity command and force of this tick; sent before anything is told."""
        ended = self.axes.control()
        self._last_packet = drive_link.encode_force(
            self.tick, self.stamp, tuple(self.axes.force.tolist())
        )
        self._answered = self.tick
        self.link.send(self._last_packet)
        self._news.controlled(self.stamp)
        return ended

    def _conclude(self, ended: bool) -> None:
        """What follows from a control tick: the end of a motion, a fault, the end of braking."""
        if ended:
            self._finished()
        elif (fault := self.axes.following_fault()) is not None and not self._brake_ticks:
            self._fail(fault)
        if self._brake_ticks:
            self._brake_ticks = 0 if self.motion.at_rest else self._brake_ticks - 1
            if not self._brake_ticks:
                self.motion.hold(self.axes.encoder)

    def controlling(self) -> bool:
        """Whether this tick is to have a force."""
        return self._states.state in (State.READY, State.MOVING) or self._brake_ticks > 0

    # -- contact ------------------------------------------------------------------------------

    def _contact(self, datagram: drive_link.Datagram, restarted: bool) -> None:
        """First encoder of a drive, or the first after it was lost or reset."""
        first = self.tick < 0
        moving = not self.motion.at_rest
        self._clock = Lockstep(self) if self.link.lockstep else RealTime(self)
        self.axes.begin(datagram.values)
        self._answered = -1
        self._last_setpoint = self._last_streamed = None
        self.link.connected = True
        self._brake_ticks = 0
        if self.link.lockstep and datagram.tick > 0 and not restarted:
            # Virtual time stood still while nobody drove: the stage may be in full motion.
            self.motion.come_to_rest(self.axes.encoder)
            self._brake_ticks = self._longest_braking
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

    def lose(self) -> None:
        """The drive is silent: hold where it was when it comes back."""
        self.link.connected = False
        self._fail(
            f'no encoder datagram from the drive at {self._drive} for '
            f'{self.link.silence():.1f} s: is it running?'
        )
        self.motion.hold(self.axes.encoder)
        self._brake_ticks = 0

    def _contact_refusal(self) -> str | None:
        return None if self.link.connected else f'no drive at {self._drive}: start it'

    # -- requests, in the thread --------------------------------------------------------------

    def _late(self, setpoint: Setpoint) -> str | None:
        return self._clock.refusal(setpoint)

    def _take(self, setpoint: Setpoint) -> None:
        if setpoint.streams:
            self._clock.took(setpoint)
        self.motion.take(setpoint, self.axes.encoder)
        self._states.handle(Event.MOVE)
        self._brake_ticks = 0  # what braked goes on as this motion, and is watched as one

    def _start_homing(self, done: Future[str]) -> None:
        # A drive that was never met yet enables the stage when it comes.
        coming = self.tick < 0 and self._enables_itself
        coming = coming and self._homing is None and self._states.state is State.DISABLED
        refused = None if coming else self._move_refusal(None)
        if refused is None and self.motion.streaming:
            refused = 'a stream is being followed: end it first'
        if refused is not None:
            done.set_exception(StageError(refused))
            return
        self._homing = done
        patience = self._awaited.ask()
        if not self.link.connected:
            self._listener.on_event(INFO, patience)
        self.begin_awaited_homing()

    def begin_awaited_homing(self) -> None:
        """Home once the drive is there and what brakes has come to rest, or give up."""
        if not self._awaited.waiting:
            return
        if self._homing is None:
            self._awaited.end()
        elif not self.link.connected:
            if reason := self._awaited.given_up():
                self._stop(reason)
        elif not self._brake_ticks:
            self._awaited.end()
            self.axes.home(self.config.homing_velocity)
            self._states.handle(Event.MOVE)

    def _finished(self) -> None:
        """A motion has come to its end and its dwell is over."""
        if self._states.state is State.MOVING:
            self._states.handle(Event.DONE)
        if self._homing is not None and not self._awaited.waiting:
            self._homed = True
            homing, self._homing = self._homing, None
            homing.set_result(f'homed: {self.axes.where()}')

    def _halt(self) -> None:
        self.motion.stop(self.axes.encoder)

    @property
    def _streaming(self) -> bool:
        return self.motion.streaming

    @property
    def _stream_timeout(self) -> float:
        return self._clock.stream_timeout

    def _switch(self, on: bool) -> str:
        state = self._states.handle(Event.ENABLE if on else Event.DISABLE)
        if not on:
            self._brake('disabled')
        elif self.motion.at_rest:
            self.axes.hold_here()
        return state.value

    def _reset(self) -> str:
        """Clear the fault; enable again where the stage does so at the start."""
        state = self._states.handle(Event.RESET)
        if state is State.DISABLED and self._enables_itself and self.link.connected:
            return self._switch(True)
        return state.value

    def _fail(self, reason: str) -> None:
        self._states.handle(Event.FAIL, reason)
        self._brake(reason)

    def _brake(self, reason: str) -> None:
        """Stop under control although the state no longer allows motion."""
        if not self.motion.at_rest and not self._brake_ticks:
            self._brake_ticks = self._longest_braking
        self._stop(reason)

    @property
    def _longest_braking(self) -> int:
        return round(BRAKE_TIMEOUT / self.axes.period)

    def end_late(self, reason: str) -> None:
        """End a motion that the drive has braked by itself meanwhile."""
        self._listener.on_event(WARNING, f'motion ended, the stage stops: {reason}')
        self._stop(reason)
        self.motion.stop_from(self.axes.encoder, self.axes.velocity)

    def _abandon(self, reason: str) -> None:
        """A motion whose stage is gone: nothing to brake."""
        self._stop(reason)
        self.motion.hold(self.axes.encoder)
        if self._states.state is State.MOVING:
            self._states.handle(Event.DONE)

    def _is_quiet(self) -> bool:
        return self.motion.at_rest and self._inbox.empty()
