"""The course of a run, free of ROS: approach, follow, learn, again; abort and faults.

Each encoder message goes in, at most one set-point comes out. Time is the messages' stamps.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from contour_ctrl.curves import circle
from contour_ctrl.figures import Figures, figures
from contour_ctrl.learning import Learner
from contour_ctrl.phases import Pair, Phase, RunSettings, SetPoint
from contour_ctrl.reference import plan
from contour_ctrl.tick import EX, QX, Controller, Gains
from stage_core import topics
from stage_core.arrays import Array
from stage_core.clocks import NANOSECONDS
from stage_core.errors import StageError

#: At rest: moved less than this [m] for this long [s]. The position loop takes 0.35 s to forget
#: the lag of the move to the start; a contour that begins earlier begins with an error of its own.
REST_MOTION, REST_TIME = 5e-6, 0.6
#: Lockstep: least time since the move was sent; the driver's own dwell makes the rest [s].
LOCKSTEP_REST = 0.1


class ContourRun:
    """Runs a controller `iterations` times.

    Parameters
    ----------
    controller
        Holds the reference and, when learned signals were reloaded, those.
    learner
        None for a scheme without iterative learning.
    report
        Called after each iteration with its index and figures.
    """

    def __init__(
        self,
        controller: Controller,
        learner: Learner | None,
        iterations: int,
        settings: RunSettings | None = None,
        report: Callable[[int, Figures], None] | None = None,
    ) -> None:
        self.controller = controller
        self.learner = learner
        self.iterations = iterations
        self.settings = RunSettings() if settings is None else settings
        self.report = report
        self.phase = Phase.APPROACH
        self.success = False
        self.message = ''
        self.results: list[Figures] = []
        self.best = 0
        self.best_weights = controller.weights.copy()
        self.missed = 0
        self.tick = -1
        self._active = controller
        self._period_ns = round(controller.reference.period * NANOSECONDS)
        self._origin = 0
        self._gaps = 0
        self._target = _pair(controller.reference.position[0])
        self._sent = -1
        self._anchor: tuple[int, float, float] | None = None
        self._last: tuple[int, float, float] | None = None
        self._reason = ''
        self._ready = False

    @property
    def done(self) -> bool:
        """Whether nothing more will be sent."""
        return self.phase is Phase.DONE

    @property
    def waits_for_quiet(self) -> bool:
        """Whether the stage rests at the start and only the world's silence is missing."""
        return self.settings.lockstep and self.phase is Phase.APPROACH and self._ready

    def awaits(self, stamp: int) -> bool:
        """Whether the run cannot go on without the set-point of this stamp [ns].

        A move to the start that was refused is not executed; a driver that refuses one set-point
        of a stream has ended the stream.
        """
        if self.phase in (Phase.STREAM, Phase.STOPPING):
            return self._origin <= stamp <= self._sent
        return self.phase is Phase.APPROACH and stamp == self._sent

    def prompt(self, stamp: int) -> bool:
        """Whether a message of this stamp [ns] is answered in microseconds.

        What learns after an iteration, or plans a feed hold, takes longer than a tick.
        """
        if self.phase is Phase.STREAM and self._reason:
            return False
        following = self.phase in (Phase.STREAM, Phase.STOPPING)
        return not following or self._index(stamp) < len(self._active)

    def _index(self, stamp: int) -> int:
        return int(round((stamp - self._origin) / self._period_ns))

    def begin(self, stamp: int) -> SetPoint:
        """Return the move to the start point."""
        self._ready = False
        return self._move(stamp, self._target)

    def on_state(self, stamp: int, qx: float, qy: float) -> SetPoint | None:
        """Take an encoder message; return the set-point to publish, if any."""
        if not (np.isfinite(qx) and np.isfinite(qy)):
            return self.fault(stamp, 'the encoder position is not a number')
        if self._last is not None and stamp <= self._last[0]:
            return None
        self._last = (stamp, qx, qy)
        if self.phase is Phase.APPROACH:
            return self._approach(stamp, qx, qy)
        if self.phase in (Phase.STREAM, Phase.STOPPING):
            return self._follow(stamp, qx, qy)
        return None

    def world_is_quiet(self) -> SetPoint | None:
        """Lockstep: nothing has been published for a while; start at the last tick seen."""
        if not self.waits_for_quiet or self._last is None:
            return None
        return self._start(*self._last)

    def silence(self, seconds: float) -> str:
        """Reason to give when no encoder message came for so long."""
        if self.phase is Phase.APPROACH and self._last is not None and self.settings.lockstep:
            distance = max(abs(self._last[i + 1] - self._target[i]) for i in range(2))
            return (
                f'the stage stands {1e3 * distance:.3f} mm from the start point: '
                'see the state and soft limits of the driver, or raise start_tolerance'
            )
        return (
            f'no encoder message on {topics.JOINT_STATES} for {seconds:.1f} s: '
            'is stage_driver running, enabled and homed?'
        )

    def newest_record(self) -> Array:
        """Return the row of the last tick: encoder, tracking error, contour errors."""
        return self._active.record[self.tick]

    def abort(self, reason: str = 'aborted by request') -> SetPoint | None:
        """Stop smoothly: a feed hold on the contour, or where the stage is."""
        self._reason = reason
        if self.phase is Phase.APPROACH:
            self._finish(False, reason)
            if self._last is None:
                return None
            stamp, qx, qy = self._last
            return self._move(stamp, (qx, qy))
        return None

    def fault(self, stamp: int, reason: str) -> SetPoint | None:
        """End the run where the stage can brake without looking at the encoder."""
        streaming = self.phase in (Phase.STREAM, Phase.STOPPING)
        self._finish(False, reason)
        if not streaming or self._last is None:
            return None
        velocity = self._active.table[min(self.tick, len(self._active) - 1), 2:4]
        end = np.array(self._last[1:]) + 0.5 * self.settings.stop_time * velocity
        return self._move(stamp, _pair(end))

    def end(self, reason: str) -> None:
        """End the run without a set-point, where the driver stops the stage by itself.

        It has refused one, was asked to stop, or misses those that should have come. Any further
        one would move a stage that rests.
        """
        self._finish(False, reason)

    def _move(self, stamp: int, target: Pair) -> SetPoint:
        # The driver takes an equal stamp for a repetition of the last set-point.
        stamp = max(stamp, self._sent + 1)
        self._sent = stamp
        self._anchor = None
        self._ready = False
        return SetPoint(stamp, target)

    def _approach(self, stamp: int, qx: float, qy: float) -> SetPoint | None:
        settings = self.settings
        anchor = self._anchor
        if anchor is None or max(abs(qx - anchor[1]), abs(qy - anchor[2])) > REST_MOTION:
            self._anchor = anchor = (stamp, qx, qy)
        distance = max(abs(qx - self._target[0]), abs(qy - self._target[1]))
        # In lockstep a world that stands still is at rest, however its last ticks crept.
        since, rest = (self._sent, LOCKSTEP_REST) if settings.lockstep else (anchor[0], REST_TIME)
        resting = stamp - since >= rest * NANOSECONDS
        self._ready = resting and distance <= settings.start_tolerance
        if self._ready and not settings.lockstep:
            return self._start(stamp, qx, qy)
        if stamp - self._sent > settings.approach_timeout * NANOSECONDS:
            self._finish(
                False,
                f'the start point was not reached in {settings.approach_timeout:g} s, '
                f'{1e3 * distance:.3f} mm are left: see the state and soft limits of the driver',
            )
        return None

    def _start(self, stamp: int, qx: float, qy: float) -> SetPoint | None:
        self.phase = Phase.STREAM
        self._active = self.controller
        self._active.restart()
        self._origin = stamp
        self.tick = -1
        self._gaps = 0
        return self._follow(stamp, qx, qy)

    def _follow(self, stamp: int, qx: float, qy: float) -> SetPoint | None:
        if self._reason and self.phase is Phase.STREAM:
            self._brake(stamp)
        k = self._index(stamp)
        if k <= self.tick:
            return None
        gap = k - self.tick - 1
        self.missed += gap
        if gap > 0 and self.phase is Phase.STREAM and (reason := self._too_much(k)):
            self.end(reason)
            return None
        self.tick = k
        if k >= len(self._active):
            return self._end(stamp)
        velocity = self._active.tick(k, qx, qy)
        self._sent = stamp
        return SetPoint(stamp, _pair(self._active.table[k]), _pair(velocity))

    def _too_much(self, k: int) -> str:
        """Reason to stop where the contour goes on without the stage: at once, or too often.

        A stage whose encoder is heard of too seldom lags, up to the driver's following error.
        """
        count = len(self._active)
        gap = min(k, count) - self.tick - 1
        self._gaps += gap
        if self._gaps > self.settings.missed_share * count:
            return (
                f'{self._gaps} of {count} ticks had no encoder message in time: '
                'relieve the machine, lower control_rate or raise missed_share'
            )
        due, now = np.minimum((self.tick + 1, k), count - 1)
        step = float(np.hypot(*(self._active.table[now, :2] - self._active.table[due, :2])))
        if step <= self.settings.longest_step:
            return ''
        return (
            f'{gap} ticks in a row had no encoder message, {1e3 * step:.1f} mm of the contour '
            f'(longest_step is {1e3 * self.settings.longest_step:g} mm): relieve the machine'
        )

    def _brake(self, stamp: int) -> None:
        """Replace the plan by its feed hold; the states of the control law go on."""
        k = min(self._index(stamp), len(self.controller) - 1)
        reference, learned = self.controller.reference.braked(
            k, self.settings.stop_time, self.controller.learned
        )
        self._active = Controller(reference, self.controller.gains)
        self._active.learned[:] = learned
        self._active.weights[:] = self.controller.weights
        self._active.memory[:] = self.controller.memory
        self._origin, self.tick = stamp, -1
        self.phase = Phase.STOPPING

    def _end(self, stamp: int) -> SetPoint:
        """After the last tick: a position-only set-point, then learn while the stage rests."""
        if self.phase is Phase.STOPPING:
            self._finish(False, self._reason)
            return self._move(stamp, _pair(self._active.table[-1]))
        self._evaluate()
        end = _pair(self.controller.table[-1])
        if len(self.results) >= self.iterations:
            self._finish(True, self._summary())
            return self._move(stamp, end)
        if self._reason:
            self._finish(False, self._reason)
            return self._move(stamp, end)
        self.phase = Phase.APPROACH
        return self._move(stamp, self._target)

    def _evaluate(self) -> None:
        """Figures of the iteration, and learning."""
        record = self.controller.record
        gaps = np.isnan(record[:, QX])
        grid = np.arange(len(gaps))
        for column in range(record.shape[1]):
            record[gaps, column] = np.interp(grid[gaps], grid[~gaps], record[~gaps, column])
        reference = self.controller.reference
        contour = reference.contour_errors(record[:, QX : QX + 2])
        result = figures(record[:, EX : EX + 2], contour)
        self.results.append(result)
        if result.contour.rms <= self.results[self.best].contour.rms:
            self.best = len(self.results) - 1
            self.best_weights[:] = self.controller.weights
        if self.learner is not None:
            try:
                self.learner.after(self.controller)
            except StageError as error:
                self._reason = self._reason or str(error)
        if self.report is not None:
            self.report(len(self.results), result)

    def _summary(self) -> str:
        first, best = self.results[0], self.results[self.best]
        text = f'{len(self.results)} iterations; first: {first.sentence()}'
        if len(self.results) > 1:
            text += f'; best, iteration {self.best + 1}: {best.sentence()}'
        return text

    def _finish(self, success: bool, message: str) -> None:
        self.phase = Phase.DONE
        self.success, self.message = success, message


def _pair(values: Array) -> Pair:
    return float(values[0]), float(values[1])


def compile_kernels() -> None:
    """Compile everything that a run calls, before there is one.

    The first tick must be answered at once, and so must the first after an iteration: the driver
    would take the seconds of a compiler for a stream that has broken off.
    """
    controller = Controller(plan(circle(0.001), 0.01), Gains())
    controller.reference.contour_errors(controller.table[:, :2])
