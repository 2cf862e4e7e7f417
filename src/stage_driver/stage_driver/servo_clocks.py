"""The two clocks of the servo backend: what a tick waits for before its force is sent.

Real time: every encoder datagram is answered at once with the newest set-point. Lockstep: virtual
time stands still until a force is sent; it is sent while a move, homing or a stop is executed,
and in a stream only for a tick whose set-point has come. Otherwise the world is quiet.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Protocol

from stage_driver.limits import Setpoint

if TYPE_CHECKING:
    from stage_driver.servo import ServoBackend

#: A driver that is late by more has lost the motion: drives brake by themselves by then [s].
LATE_LIMIT = 0.02


class Clock(Protocol):
    """What differs between real time and lockstep; made anew with each contact to a drive."""

    name: str
    #: A drive that is silent for longer is lost [s].
    patience: float
    #: Wall time without set-points after which a stream is over [s].
    stream_timeout: float
    #: Whether the drive waits: the state of a tick is told before its force is computed.
    waits: bool

    def missed(self, ticks: int) -> None:
        """Take note of ticks that never came."""

    def answer(self) -> bool | None:
        """Send the force of this tick; whether a motion ended, None where nothing was sent."""

    def refusal(self, setpoint: Setpoint) -> str | None:
        """Why a streamed set-point is not for this tick, or None."""

    def took(self, setpoint: Setpoint) -> None:
        """Take note of a streamed set-point that is followed."""


class RealTime:
    """The drive goes on by itself: a force is for the newest tick, or of no use."""

    name, waits = 'real', False

    def __init__(self, backend: ServoBackend) -> None:
        self._backend = backend
        self.patience = backend.config.link_timeout
        self.stream_timeout = backend.config.setpoint_timeout
        #: Ticks by which the driver is behind the drive; whether the stage moved at the first.
        self._late, self._moved = 0, False
        self._stream_age = 0

    def missed(self, ticks: int) -> None:
        """See `Clock.missed`."""
        if not self._late:
            self._moved = not self._backend.motion.at_rest
        self._late += ticks

    @property
    def _lateness(self) -> float:
        return self._late * self._backend.axes.period

    def answer(self) -> bool | None:
        """See `Clock.answer`."""
        backend = self._backend
        over = backend.link.newer_waits()
        if over:
            backend.counts['late_ticks'] += 1
            self.missed(1)
        backend.serve()
        if over:
            return self._let_pass()
        backend.begin_awaited_homing()
        self._end_if_late()
        if not backend.controlling():
            return None
        self._watch_stream()
        return backend.control()

    def _let_pass(self) -> bool | None:
        """A tick that is over: a force for it would come late; its reference goes by."""
        if self._lateness > LATE_LIMIT or not self._backend.controlling():
            return None
        self._watch_stream()
        return self._backend.axes.control() or None

    def _end_if_late(self) -> None:
        """Up to date again: a motion that the drive has braked meanwhile is ended."""
        backend, late = self._backend, self._lateness
        self._late = 0
        if late > LATE_LIMIT and self._moved and not backend.motion.at_rest:
            backend.end_late(
                f'the driver was late by {late * 1e3:.0f} ms: lower the load of this machine'
            )

    def _watch_stream(self) -> None:
        """Bring the stage to rest when the stream's set-points stop coming."""
        backend = self._backend
        if not backend.motion.streaming:
            return
        self._stream_age += 1
        # One tick is the way through another process.
        backend.counts['late_setpoints'] += self._stream_age > 2
        if self._stream_age * backend.axes.period > self.stream_timeout:
            backend.watchdog(f'no set-point for {self.stream_timeout} s')

    def refusal(self, setpoint: Setpoint) -> str | None:
        """See `Clock.refusal`."""
        return None

    def took(self, setpoint: Setpoint) -> None:
        """See `Clock.took`."""
        self._stream_age = 0


class Lockstep:
    """The drive waits for the force of its tick, which repeats several times a second."""

    name, waits = 'lockstep', True

    def __init__(self, backend: ServoBackend) -> None:
        self._backend = backend
        self.patience = self.stream_timeout = backend.config.lockstep_timeout
        self._stream_stamp = -1

    def missed(self, ticks: int) -> None:
        """See `Clock.missed`."""

    def answer(self) -> bool | None:
        """Serve requests until this tick is due, then answer it."""
        backend = self._backend
        backend.serve()
        backend.begin_awaited_homing()
        waiting_since = time.monotonic()
        while not backend.ended.is_set():
            if self._due():
                return backend.control()
            if backend.serve_next():
                continue
            if backend.link.peek_reset():
                return None
            # A drive that waits repeats its tick several times a second.
            if backend.link.silence() > self.patience:
                backend.lose()
                return None
            waited = time.monotonic() - waiting_since
            if backend.motion.streaming and waited > self.patience:
                backend.watchdog(f'no set-point for tick {backend.tick} in {waited:.0f} s')
        return None

    def _due(self) -> bool:
        motion = self._backend.motion
        if not self._backend.controlling() or motion.at_rest:
            return False
        return not motion.streaming or self._stream_stamp == self._backend.stamp

    def refusal(self, setpoint: Setpoint) -> str | None:
        """See `Clock.refusal`."""
        backend = self._backend
        if setpoint.stamp == backend.stamp:
            return None
        backend.counts['late_setpoints'] += 1
        return (
            f'stamped {setpoint.stamp} ns while tick {backend.tick} of {backend.stamp} ns waits: '
            'stamp it as the newest /stage/joint_states'
        )

    def took(self, setpoint: Setpoint) -> None:
        """See `Clock.took`."""
        self._stream_stamp = setpoint.stamp
