"""What drives the machine's time: the wall clock, or the driver's forces (lockstep)."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Protocol

from stage_core import drive_link
from stage_core.clocks import NANOSECONDS
from stage_twin.emulators.drive import DriveSocket, Pacer
from stage_twin.machine import ServoMachine

LOCKSTEP_START_NS = NANOSECONDS
RESEND_AFTER = 0.2
LONGEST_WAIT = 0.05
BRAKING_LIMIT = 2.0
#: A force for a tick longer ago is refused: a loop closed that late drives the stage to and fro.
STALE_TICKS = 5
#: The plant waits for so long [s] when a force is late: an operating system that takes the driver
#: off its core must not look like an axis that runs away. Counted; a short wait is caught up, of
#: a long one the rest is time that did not pass for the plant (see `Pacer`).
PATIENCE = 0.25


class TrackerOutput(Protocol):
    """Where tracker points go: TPI server or text sender."""

    def push(self, time_ns: int, point: tuple[float, float, float]) -> None:
        """Take a point [m] with its time [ns]."""

    def flush(self) -> None:
        """Return when every point has been written."""


class _Loop(threading.Thread, ABC):
    """A thread that owns the machine; others ask it for a reset and read its counters."""

    def __init__(
        self, machine: ServoMachine, drive: DriveSocket, tracker: TrackerOutput | None
    ) -> None:
        super().__init__(name='plant', daemon=True)
        self.machine = machine
        self.drive = drive
        self.tracker = tracker
        self.tick = 0
        self.ticks = 0
        self.stamp = 0
        self.origin = 0
        self.braked = 0
        self.braking = False
        self.failure: BaseException | None = None
        self._ended = threading.Event()
        self._reset_wanted = threading.Event()
        self._reset_done = threading.Event()

    def run(self) -> None:
        """Run until `stop`; what goes wrong is kept in `failure`."""
        try:
            self._run()
        except Exception as error:
            self.failure = error

    @abstractmethod
    def _run(self) -> None:
        """Let time pass until `stop`."""

    def stop(self) -> None:
        """End the thread and close the drive link."""
        self._ended.set()
        if self.is_alive():
            self.join(timeout=5.0)
        self.drive.close()

    def reset(self, timeout: float = 2.0) -> bool:
        """Put the stage at rest at zero; ticks start anew. Return whether it was done in time."""
        self._reset_done.clear()
        self._reset_wanted.set()
        return self._reset_done.wait(timeout)

    def summary(self) -> str:
        """Return where the devices are, in one line."""
        return f'drive link on 127.0.0.1:{self.drive.port}'

    def status(self) -> tuple[int, str, dict[str, Any]]:
        """Return level (0 fine, 1 warning, 2 error), sentence and values for /diagnostics."""
        values: dict[str, Any] = {
            'ticks': self.ticks,
            'time': f'{self.stamp / NANOSECONDS:.3f}',
            'braked_ticks': self.braked,
            'refused_datagrams': self.drive.refused,
            **self._counters(),
        }
        if self.failure is not None:
            return 2, f'the plant has stopped: {self.failure}: start stage_twin again', values
        if not self.drive.connected:
            return 1, 'waits for a driver on the drive link', values
        if self.braking:
            return 1, 'no force from the driver: dynamic braking', values
        return 0, 'running', values

    @abstractmethod
    def _counters(self) -> dict[str, Any]:
        """Return what only this clock counts."""

    def _apply_reset(self) -> int:
        """Do a wanted reset; return the flags of the next encoder datagram."""
        if not self._reset_wanted.is_set():
            return 0
        self._reset_wanted.clear()
        self.machine.reset()
        self.tick = 0
        self.origin = self.stamp
        self._reset_done.set()
        return drive_link.RESET

    def _send_encoder(self, flags: int) -> None:
        self.drive.send(
            self.tick, self.stamp, self.machine.positions(), self.machine.temperatures(), flags
        )

    def _send_points(self) -> None:
        if self.tracker is not None:
            for time_ns, point in self.machine.tracker_points():
                self.tracker.push(self.origin + time_ns, point)

    def _advance(self, force: tuple[float, ...] | None) -> None:
        """Let one tick pass with a force, or with the brake where there is none."""
        self.braking = force is None
        if force is None:
            self.machine.brake()
            self.braked += 1
        else:
            self.machine.step(force)
        self.tick += 1
        self.ticks += 1


class RealTimeLoop(_Loop):
    """Tick at absolute deadlines; interval k takes force k, which is awaited for a while.

    Parameters
    ----------
    watchdog
        Without a force for this long the drive brakes [s].
    """

    def __init__(
        self,
        machine: ServoMachine,
        drive: DriveSocket,
        tracker: TrackerOutput | None,
        watchdog: float = 0.02,
    ) -> None:
        super().__init__(machine, drive, tracker)
        self.pacer = Pacer(machine.period)
        self.late_forces = 0
        self.stale_forces = 0
        self.held_ticks = 0
        self._watchdog_ticks = max(1, round(watchdog / machine.period))

    def _counters(self) -> dict[str, Any]:
        return {
            'late_forces': self.late_forces,
            'stale_forces': self.stale_forces,
            'held_ticks': self.held_ticks,
            'missed_ticks': self.pacer.missed,
            'worst_lateness': f'{self.pacer.worst:.6f}',
            'pauses': self.pacer.pauses,
        }

    def _run(self) -> None:
        self.stamp = self.origin = time.time_ns()
        self.pacer.start()
        force: tuple[float, ...] | None = None
        silent = 0
        self._send_points()
        self._send_encoder(0)
        while not self._ended.is_set():
            before = self.pacer.deadline
            self.pacer.next()
            fresh, newest = self._collect()
            if not fresh and force is not None and silent <= 1:
                fresh, newest = self._await_force(newest)
            moved = round((self.pacer.deadline - before) * NANOSECONDS)
            if newest is not None:
                force = newest
                silent = 0
            silent += 1
            if silent > self._watchdog_ticks:
                force = None
            elif not fresh and force is not None:
                self.late_forces += 1
            self._advance(force)
            self.stamp += moved
            # Time that a suspended machine has lost did not pass for the plant.
            self.origin += moved - self.machine.period_ns
            self._send_points()
            flags = self._apply_reset()
            if flags:
                force = None
            self._send_encoder(flags)

    def _collect(self) -> tuple[bool, tuple[float, ...] | None]:
        """Whether the force of this tick has come, and the newest force that has."""
        fresh, newest = False, None
        while (datagram := self.drive.receive()) is not None:
            if datagram.tick < self.tick - STALE_TICKS:
                self.stale_forces += 1
                continue
            newest = datagram.values
            fresh = fresh or datagram.tick == self.tick
        return fresh, newest

    def _await_force(
        self, newest: tuple[float, ...] | None
    ) -> tuple[bool, tuple[float, ...] | None]:
        """Wait while the driver of a busy machine is late (see `PATIENCE`)."""
        begin = time.monotonic()
        fresh = False
        while not fresh and (left := begin + PATIENCE - time.monotonic()) > 0.0:
            if self.drive.wait(left):
                fresh, came = self._collect()
                newest = newest if came is None else came
        self.pacer.let_go()
        self.held_ticks += 1
        return fresh, newest


class LockstepLoop(_Loop):
    """Virtual time from 1 s on, which stands still until the force of the tick has come.

    Parameters
    ----------
    publish_clock
        Called with the time [ns], and again while the world waits, for those who join late.
    clock_interval
        Ticks between two calls of `publish_clock` while time runs.
    watchdog
        Without a force for this long (wall clock) a stage in motion brakes to rest [s].
    """

    def __init__(
        self,
        machine: ServoMachine,
        drive: DriveSocket,
        tracker: TrackerOutput | None,
        publish_clock: Callable[[int], None],
        watchdog: float = 8.0,
        clock_interval: int = 1,
    ) -> None:
        super().__init__(machine, drive, tracker)
        self._publish_clock = publish_clock
        self._clock_interval = clock_interval
        self._published: int | None = None
        self._watchdog = watchdog
        self.repeated = 0

    def _counters(self) -> dict[str, Any]:
        return {'repeated_encoders': self.repeated}

    def _run(self) -> None:
        self.stamp = self.origin = LOCKSTEP_START_NS
        self._deliver(0)
        while not self._ended.is_set():
            force = self._await_force()
            if self._reset_wanted.is_set():
                self._deliver(self._apply_reset())
            elif force is not None:
                self._pass_tick(force)
            elif not self._ended.is_set():
                self._brake_to_rest()

    def _deliver(self, flags: int) -> None:
        """Make tick k known: points up to t_k first, then the time, then encoder k."""
        self._send_points()
        if self.tracker is not None:
            self.tracker.flush()
        if self.tick % self._clock_interval == 0:
            self._tell_time()
        self._send_encoder(drive_link.LOCKSTEP | flags)

    def _tell_time(self) -> None:
        self._publish_clock(self.stamp)
        self._published = self.stamp

    def _pass_tick(self, force: tuple[float, ...] | None) -> None:
        self._advance(force)
        self.stamp += self.machine.period_ns
        self._deliver(0)

    def _brake_to_rest(self) -> None:
        for _ in range(round(BRAKING_LIMIT / self.machine.period)):
            if self.machine.at_rest or self._ended.is_set():
                return
            self._pass_tick(None)

    def _await_force(self) -> tuple[float, ...] | None:
        """Wait for the force of this tick; None to end, reset, or brake."""
        begin = repeat_at = time.monotonic()
        while not self._ended.is_set() and not self._reset_wanted.is_set():
            while (datagram := self.drive.receive()) is not None:
                if datagram.tick == self.tick:
                    return datagram.values
            now = time.monotonic()
            if self.drive.greeted or now - repeat_at > RESEND_AFTER:
                self.drive.greeted = False
                repeat_at = now
                self.repeated += 1
                self._tell_time()
                self._send_encoder(drive_link.LOCKSTEP | drive_link.REPEATED)
            if now - begin > self._watchdog and self.machine.moving:
                return None
            if not self.drive.wait(LONGEST_WAIT) and self._published != self.stamp:
                self._tell_time()
        return None
