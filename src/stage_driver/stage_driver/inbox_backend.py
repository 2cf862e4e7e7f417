"""What both backends share: requests of other threads become calls in the backend's thread.

No call of another thread blocks: futures are resolved by the backend's thread.
"""

from __future__ import annotations

import queue
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import Future

from stage_core.errors import StageError
from stage_driver.backend import FAILURE, INFO, WARNING, Listener, Status
from stage_driver.config import DriverConfig
from stage_driver.limits import AxisLimits, Setpoint, check_setpoint
from stage_driver.states import Event, State, StateMachine

#: A stream that somebody has stopped goes on after such a pause [s], if not by a move: a contour
#: controller that hears of nothing for half of it has given up.
ASKED_PAUSE = 1.0


class InboxBackend(ABC):
    """State machine, inbox, checked set-points, homing's future, refusals."""

    def __init__(self, config: DriverConfig, listener: Listener) -> None:
        self._config = config
        #: Soft limits in the order of the axes.
        self._limits: Sequence[AxisLimits] = config.limits
        self._listener = listener
        self._states = StateMachine(self._state_changed)
        self._inbox: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._homing: Future[str] | None = None
        self._homed = False
        #: Whether `~/enable` asked last for a disabled stage, which nothing else may enable.
        self._kept_disabled = False
        self.counts = {'refused': 0, 'stops': 0, 'watchdog_stops': 0, 'rival_setpoints': 0}
        self._last_stop = ''
        self._last_refusal = ''
        self._refused_stamp = 0
        self._last_setpoint: Setpoint | None = None
        #: The last streamed one, whether it was taken or refused.
        self._last_streamed: Setpoint | None = None
        #: When it came [s], whether the stage was stopped since, and for which pause [s] no stream
        #: then goes on.
        self._streamed_at, self._stopped, self._needed_pause = 0.0, False, 0.0
        self._ending = threading.Event()
        #: How often a stop was asked for: what waited meanwhile is not executed any more.
        self._stops_asked = 0

    # -- calls from other threads -------------------------------------------------------------

    @abstractmethod
    def start(self) -> None:
        """Open the wire and start the thread; StageError where that is impossible."""

    @abstractmethod
    def close(self) -> None:
        """Bring the stage to rest, end the thread, close the wire."""

    @abstractmethod
    def stop(self) -> str:
        """Start a controlled stop and return at once."""

    @abstractmethod
    def status(self) -> Status:
        """State and counters of now."""

    def submit(
        self,
        stamp: int,
        names: Sequence[str],
        positions: Sequence[float],
        velocities: Sequence[float],
    ) -> None:
        """Check a set-point and hand it over; a refused one is an event and moves nothing."""
        try:
            setpoint = check_setpoint(
                self._config.axes, self._limits, stamp, names, positions, velocities
            )
        except StageError as error:
            reason = str(error)
            self._refuse(reason, stamp)
            # A stream that has turned into rubbish must not be followed any further. One request
            # is enough: a flood of rubbish must not fill the inbox.
            if not self._ending.is_set():
                self._ending.set()
                self._inbox.put(lambda: self._end_refused_stream(reason))
            return
        self._unless_stopped(
            lambda: self._receive(setpoint),
            lambda reason: self._refuse(f'set-point refused: {reason}', stamp),
        )

    def home(self) -> Future[str]:
        """Home all axes; the future ends when they are home, or fails with a StageError."""
        done: Future[str] = Future()
        self._unless_stopped(
            lambda: self._start_homing(done),
            lambda reason: done.set_exception(StageError(reason)),
        )
        return done

    def reset_fault(self) -> Future[str]:
        """Clear a latched fault."""
        return self._request(self._reset)

    def enable(self, on: bool) -> Future[str]:
        """Enable or disable the stage."""

        def switch() -> str:
            self._kept_disabled = not on
            return self._switch(on)

        return self._request(switch)

    def _ask_stop(self) -> None:
        self._stops_asked += 1
        self._inbox.put(lambda: self._stop('stopped by request'))

    def _unless_stopped(self, request: Callable[[], None], refuse: Callable[[str], None]) -> None:
        """Have a request served, or refused if a stop is asked for while it waits."""
        asked = self._stops_asked

        def serve() -> None:
            if asked == self._stops_asked:
                request()
            else:
                refuse('the stage was stopped while it waited')

        self._inbox.put(serve)

    def _request(self, action: Callable[[], str]) -> Future[str]:
        """Future of an action in the backend's thread."""
        done: Future[str] = Future()

        def answer() -> None:
            try:
                done.set_result(action())
            except StageError as error:
                done.set_exception(error)
            except Exception as error:
                # The wire broke: the caller learns it here, the thread deals with it.
                done.set_exception(StageError(f'{error}: check the cable'))
                raise

        self._inbox.put(answer)
        return done

    # -- what a backend adds, called in its thread --------------------------------------------

    @abstractmethod
    def _contact_refusal(self) -> str | None:
        """What is missing on the wire, or None."""

    @abstractmethod
    def _take(self, setpoint: Setpoint) -> None:
        """Execute a set-point that nothing speaks against."""

    @abstractmethod
    def _start_homing(self, done: Future[str]) -> None:
        """Start homing, or fail `done`."""

    @abstractmethod
    def _reset(self) -> str:
        """Clear the fault; the new state."""

    @abstractmethod
    def _switch(self, on: bool) -> str:
        """Enable or disable; the new state."""

    @abstractmethod
    def _halt(self) -> None:
        """Start a controlled stop of whatever moves."""

    @property
    def _enables_itself(self) -> bool:
        return self._config.enable_on_start and not self._kept_disabled

    @property
    @abstractmethod
    def _streaming(self) -> bool:
        """Whether a stream of set-points is being followed."""

    @property
    def _stream_timeout(self) -> float:
        """Wall time without set-points after which a stream is over [s]."""
        return self._config.setpoint_timeout

    # -- in the backend's thread --------------------------------------------------------------

    def serve(self) -> None:
        """Serve every waiting request."""
        while self.serve_next(0.0):
            pass

    def serve_next(self, patience: float = 0.05) -> bool:
        """Serve the next request, waited for up to `patience` [s]; whether there was one."""
        try:
            request = self._inbox.get(patience > 0.0, patience or None)
        except queue.Empty:
            return False
        request()
        return True

    def _move_refusal(self, contact: str | None) -> str | None:
        """Why nothing may move now, or None; `contact` says what is missing on the wire."""
        if self._homing is not None:
            return 'homing is under way: wait for it or call ~/stop'
        return self._states.refusal(Event.MOVE) or contact

    def _refusal(self, setpoint: Setpoint) -> str | None:
        """Why a checked set-point is refused, or None."""
        refused = self._move_refusal(self._contact_refusal())
        if refused is None and not self._homed and self._config.home_required:
            refused = 'the stage is not homed: call ~/home first'
        return refused

    def _receive(self, setpoint: Setpoint) -> None:
        """Count what only a second controller can have sent, and take the set-point."""
        last = self._last_streamed
        if setpoint.streams:
            # A controller's stamps rise, and it sends one set-point for a tick. In a fault as
            # well: two that contradict each other soon end in one.
            if last is not None and 0 < setpoint.stamp <= last.stamp and setpoint != last:
                self.counts['rival_setpoints'] += 1
            self._last_streamed = setpoint
        if self._repeats(setpoint):
            return
        refused = self._refusal(setpoint)
        if setpoint.streams:
            if self._goes_on():
                wait = f'pause it for {self._needed_pause} s, or send a move'
                refused = refused or f'the stream was stopped: {wait}'
            elif refused is not None and not self._streaming:
                # What ends the reason, such as ~/enable, must not set the stage in motion.
                self._stopped, self._needed_pause = True, self._stream_timeout
            refused = refused or self._late(setpoint)
        if refused is not None:
            self._refuse(f'set-point refused: {refused}', setpoint.stamp)
            return
        self._last_setpoint = setpoint
        self._stopped = False
        self._take(setpoint)

    def _late(self, setpoint: Setpoint) -> str | None:
        """Why a streamed set-point is not for this tick, or None."""
        return None

    def _goes_on(self) -> bool:
        """Whether a stream sends set-points without a pause although the stage was stopped."""
        now = time.monotonic()
        paused = now - self._streamed_at > self._needed_pause
        self._streamed_at = now
        return self._stopped and not paused

    def _repeats(self, setpoint: Setpoint) -> bool:
        """Whether this is the last set-point again, sent for the case that it got lost.

        What has corrected it since may have moved its last digits.
        """
        previous = self._last_setpoint
        return (
            previous is not None
            and setpoint.stamp == previous.stamp != 0
            and setpoint.kind is previous.kind
            and setpoint.named == previous.named
        )

    def _stop(self, reason: str) -> None:
        """Controlled stop; homing fails with the reason, a stream is refused until it pauses."""
        self._stopped, self._needed_pause = True, max(ASKED_PAUSE, self._stream_timeout)
        self._last_stop = reason
        self.counts['stops'] += 1
        self._listener.on_event(INFO, f'stop: {reason}')
        self._halt()
        if self._homing is not None:
            homing, self._homing = self._homing, None
            homing.set_exception(StageError(f'homing ended: {reason}'))

    def _end_stream(self, reason: str) -> None:
        """Controlled stop of a stream; other motions go on."""
        if self._streaming:
            self._listener.on_event(WARNING, f'stream ended, the stage stops: {reason}')
            self._stop(reason)
            self._needed_pause = self._stream_timeout

    def _end_refused_stream(self, reason: str) -> None:
        self._ending.clear()
        self._end_stream(reason)

    def watchdog(self, reason: str) -> None:
        """End a stream whose set-points stopped coming."""
        self.counts['watchdog_stops'] += 1
        self._end_stream(reason)

    def behind(self, reason: str) -> None:
        """End a stream or a homing whose answers come late; a move ends without us."""
        if self._streaming:
            self.watchdog(reason)
            return
        self._listener.on_event(WARNING, reason)
        if self._homing is not None:  # whether every axis took the command is not known
            self._stop(reason)

    def _refuse(self, reason: str, stamp: int) -> None:
        self.counts['refused'] += 1
        self._last_refusal, self._refused_stamp = reason, stamp
        self._listener.on_event(WARNING, reason)

    def _details(self) -> dict[str, str]:
        """Counters for `/diagnostics`."""
        details = {name: str(value) for name, value in self.counts.items()}
        if self._last_stop:
            details['last_stop'] = self._last_stop
        if self._last_refusal:
            details['last_refusal'] = self._last_refusal
            details['refused_stamp'] = str(self._refused_stamp)
        return details

    def _state_changed(self, before: State, after: State, reason: str) -> None:
        if after is State.FAULT:
            self._listener.on_event(FAILURE, f'fault: {reason}')
