"""The Zaber backend in lockstep with an emulated chain: time passes only while it speaks.

It polls while anything moves and through the dwell after it; a stream's next move is sent, and
the next poll made, when the set-point stamped with the newest poll has come. Then the world
stands still until the next request, and the same requests give the same session again.
"""

from __future__ import annotations

import time
from concurrent.futures import Future
from dataclasses import replace

from stage_core.clocks import LOCKSTEP_EXCHANGE, NANOSECONDS
from stage_driver.backend import Listener
from stage_driver.config import ZaberConfig
from stage_driver.limits import Setpoint
from stage_driver.states import State
from stage_driver.zaber import ZaberBackend
from stage_driver.zaber_clock import LineClock
from stage_driver.zaber_link import LinkLost
from stage_driver.zaber_stage import Poll, ZaberStage


class LockstepZaberBackend(ZaberBackend):
    """See the module; `origin` is the time on /clock [ns] before the first line is sent."""

    def __init__(self, config: ZaberConfig, listener: Listener, origin: int) -> None:
        # An emulator that waits for its turn on a busy machine is not lost: a line that was sent
        # again would let more time pass on one run than on another.
        patience = config.lockstep_timeout
        config = replace(config, reply_timeout=patience, link_timeout=2.0 * patience)
        super().__init__(config, listener, LineClock(origin))
        self._changed = 0
        self._settling_at: list[float] = []
        self._waiting_since = 0.0
        self.counts['late_setpoints'] = 0

    @property
    def _stream_timeout(self) -> float:
        return self.config.lockstep_timeout

    def _step(self, stage: ZaberStage) -> None:
        if not self._due():
            self._await_request(stage)
            return
        if self._streaming and self._last is not None:
            self._fail_if(self._motion.send(stage, self._last))
            self._keep_grid(stage, self._last)
        poll = self._poll(stage)
        if poll is not None:
            self._watch_flags(stage, poll)
            self._progress(poll)
            self._publish(stage, poll)
        self._waiting_since = time.monotonic()

    def _keep_grid(self, stage: ZaberStage, last: Poll) -> None:
        """Let time pass up to a whole number of ticks since the last poll.

        Whoever streams counts ticks by their stamps: a question between two of them must not
        make one so long that the next set-point is for neither.
        """
        period = round(NANOSECONDS / self.config.rate)
        elapsed = self._clock.now() + LOCKSTEP_EXCHANGE * len(self.config.axes) // 2 - last.stamp
        for _ in range(-elapsed % period // LOCKSTEP_EXCHANGE):
            stage.link.ask('', self.config.devices[0])

    def _pause(self, seconds: float) -> None:
        # Only a stage that is not there is looked for now and then.
        if self._stage is None:
            super()._pause(seconds)

    def _due(self) -> bool:
        """Whether time may pass."""
        last = self._last
        if last is None:
            return True
        if self._motion.stream is not None:
            return self._motion.stream.stamp == last.stamp
        return self._states.state is State.MOVING or any(last.busy)

    def _await_request(self, stage: ZaberStage) -> None:
        if not self.serve_next() and stage.link.lost:
            raise LinkLost(f'port {self.config.port} is gone')
        waited = time.monotonic() - self._waiting_since
        if self._streaming and waited > self.config.lockstep_timeout and not self._due():
            self.watchdog(f'no set-point for {self._clock.now()} ns in {waited:.0f} s')

    def _at_rest(self, poll: Poll) -> bool:
        """At rest since `settle_time` of virtual time, counted from the last published change.

        Whoever reads the topics can tell so from the stamps which poll is the last one.
        """
        last, references = self._last, list(self._motion.references)
        if last is None or last.steps != poll.steps or references != self._settling_at:
            self._changed, self._settling_at = poll.stamp, references
        dwelt = poll.stamp - self._changed
        return super()._at_rest(poll) and dwelt >= int(self.config.settle_time * NANOSECONDS)

    def _read_temperatures(self, stage: ZaberStage, stamp: int) -> None:
        # The questions would make one tick of a stream longer than the others.
        if not self._streaming:
            super()._read_temperatures(stage, stamp)

    def _refusal(self, setpoint: Setpoint) -> str | None:
        last = self._last
        if setpoint.streams and last is not None and setpoint.stamp != last.stamp:
            self.counts['late_setpoints'] += 1
            return (
                f'stamped {setpoint.stamp} ns while the poll of {last.stamp} ns waits: '
                'stamp it as the newest /stage/joint_states'
            )
        return super()._refusal(setpoint)

    def _take(self, setpoint: Setpoint) -> None:
        super()._take(setpoint)
        self._begin_dwell()

    def _start_homing(self, done: Future[str]) -> None:
        super()._start_homing(done)
        self._begin_dwell()

    def _begin_dwell(self) -> None:
        if self._last is not None:
            self._changed = max(self._changed, self._last.stamp)
