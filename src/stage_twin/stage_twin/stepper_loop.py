"""The stepper stage behind its pseudo-terminal, with the tracker that watches it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from stage_core.clocks import LOCKSTEP_EXCHANGE, NANOSECONDS
from stage_core.twin_file import TwinFile
from stage_twin.emulators.zaber import ZaberChain
from stage_twin.emulators.zaber_pty import ZaberPty
from stage_twin.loops import LOCKSTEP_START_NS, RESEND_AFTER, TrackerOutput
from stage_twin.stepper import StepperPlant


class StepperLoop:
    """Zaber chain on a pseudo-terminal; its thread moves the plant and samples the tracker.

    Parameters
    ----------
    twin
        A twin file of kind stepper.
    seed
        Seed of the scatter of moves and of the tracker's noise.
    noise
        Whether the tracker is noisy.
    link
        Symbolic link to the terminal; empty: none.
    publish_clock
        Lockstep: called with the time [ns] whenever an exchange lets time pass, and again while
        the world waits. None: the wall clock drives time.
    """

    def __init__(
        self,
        twin: TwinFile,
        tracker: TrackerOutput | None,
        seed: int = 0,
        noise: bool = True,
        link: str = '',
        publish_clock: Callable[[int], None] | None = None,
    ) -> None:
        _warm_up(twin)
        self._plant = StepperPlant(twin, seed)
        self._plant.reset([0.0] * len(twin.axes))
        self._tracker = tracker
        self._noise = noise
        self._interval = 1.0 / twin.tracker.rate if twin.tracker else 0.0
        self._publish_clock = publish_clock
        self._origin = LOCKSTEP_START_NS if publish_clock else time.time_ns()
        self._due = 0
        self._stamp = 0
        self._published = 0.0
        self._server = ZaberPty(
            ZaberChain(self._plant, layout=(1,) * len(twin.axes)),
            link=link or None,
            exchange_time=LOCKSTEP_EXCHANGE / NANOSECONDS if publish_clock else None,
            advanced=self._advanced,
        )

    def start(self) -> None:
        """Open the terminal and serve it."""
        # The first point does not depend on whether the host or the first poll comes first.
        self._advanced(0.0)
        self._server.start()

    def stop(self) -> None:
        """Close the terminal."""
        self._server.close()

    def reset(self) -> bool:
        """Switch the chain off and on: its axes must be homed again."""
        self._server.power_cycle()
        return True

    def summary(self) -> str:
        """Return where the devices are, in one line."""
        return f'Zaber chain on {self._server.port}'

    def status(self) -> tuple[int, str, dict[str, Any]]:
        """Return level (0 fine), sentence and values for /diagnostics."""
        values = {
            'port': self._server.port,
            'time': f'{self._stamp / NANOSECONDS:.3f}',
            'dropped_lines': self._server.chain.dropped_lines,
        }
        return 0, 'running', values

    def _advanced(self, seconds: float) -> None:
        """Measure what is due; called in the terminal's thread, before its answer is written."""
        now_due = self._interval and seconds + 1e-9 >= self._due * self._interval
        if self._tracker is not None and now_due:
            while self._due * self._interval <= seconds + 1e-9:
                self._due += 1
            stamp, point = self._plant.tracker_point(seconds, self._noise)
            x, y, z = point.tolist()
            self._tracker.push(self._origin + round(stamp * NANOSECONDS), (x, y, z))
            if self._publish_clock is not None:
                self._tracker.flush()
        stamp_ns = self._origin + round(seconds * NANOSECONDS)
        now = time.monotonic()
        waits = stamp_ns == self._stamp
        self._stamp = stamp_ns
        if self._publish_clock and not (waits and now - self._published < RESEND_AFTER):
            self._published = now
            self._publish_clock(stamp_ns)


def _warm_up(twin: TwinFile) -> None:
    """Compile what a motion needs on a plant of its own: the first host meets a ready chain."""
    plant = StepperPlant(twin)
    plant.reset([0.0] * len(twin.axes))
    plant.move_abs(0, 100.0)
    plant.advance_to(0.001)
    plant.tracker_point(0.002)
