"""The servo axes in a control tick: velocity estimate, motion generator, control law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stage_core.arrays import Array
from stage_driver import servo_loop
from stage_driver.config import ServoConfig
from stage_driver.motion import Mode, MotionGenerator


class ServoAxes:
    """Arrays of all axes and one control tick on them; no I/O, nothing allocated in a tick."""

    def __init__(self, config: ServoConfig) -> None:
        self._axes = config.axes
        self._friction = config.friction
        self._following_limit = config.following_error_limit
        self.period = config.twin.control_period
        self._gains = servo_loop.loop_gains(config.twin, config.axes)
        self.motion = MotionGenerator(
            config.limits, self._gains, self.period, config.max_jerk, config.settle_time
        )
        count = len(config.axes)
        self.encoder = np.zeros(count)
        self.command = np.zeros(count)
        self.force = np.zeros(count)
        self._memory = servo_loop.start_memory(self.encoder)
        self._bristles = np.zeros(count)
        self._lag = np.maximum(servo_loop.following_lag(self._gains), self.period)
        self._expected = np.zeros(count)
        self._predicted = np.zeros(count)
        self._warm_up()

    @property
    def velocity(self) -> Array:
        """Estimated velocity vf_k (axes,) [m/s]."""
        return self._memory[:, servo_loop.VELOCITY]

    def begin(self, positions: Sequence[float]) -> None:
        """Start anew at rest at `positions` [m]: the drive is new, or its position jumped."""
        self.encoder[:] = positions
        self._memory[:] = servo_loop.start_memory(self.encoder)
        self._bristles[:] = 0.0
        self._expect_rest()
        self.motion.hold(self.encoder)

    def hold_here(self) -> None:
        """Hold the present position with an empty integrator."""
        self.motion.hold(self.encoder)
        self._memory[:, servo_loop.INTEGRAL] = 0.0
        self._bristles[:] = 0.0
        self._expect_rest()

    def home(self, speed: float) -> None:
        """Move to the reference position at `speed` [m/s]."""
        count = len(self._axes)
        self.motion.move(np.zeros(count), np.full(count, speed), self.encoder)

    def where(self) -> str:
        """The encoder's positions for a person."""
        return ', '.join(
            f'{axis} {value:.6f} m' for axis, value in zip(self._axes, self.encoder, strict=True)
        )

    def _expect_rest(self) -> None:
        self._expected[:] = 0.0
        self._predicted[:] = self.encoder

    def measure(self, positions: Sequence[float] | Array, ticks: int = 1) -> None:
        """Take the encoder's positions q_k [m], `ticks` after those before."""
        self.encoder[:] = positions
        servo_loop.estimate_velocity(self.encoder, self._memory, self._gains, ticks * self.period)

    def control(self) -> bool:
        """Compute `motion.reference`, `command` and `force`; True when a motion ended."""
        motion = self.motion
        done = motion.tick(self.encoder)
        if motion.follows_reference:
            servo_loop.position_loop(
                motion.reference, motion.speed, self.encoder, self._gains, motion.command
            )
        self.command[:] = motion.command
        if self._friction is not None:
            servo_loop.lugre_velocity(
                motion.command,
                self._bristles,
                self._friction,
                self._gains,
                self.period,
                self.command,
            )
        servo_loop.velocity_loop(self.command, self._memory, self._gains, self.period, self.force)
        # The error of a loop of first order: de/dt = dr/dt - e / lag. A stream that skips ticks
        # moves its reference in steps, which the momentary speed would misjudge; while it is late
        # the axis goes on with it: that is for the watchdog to end, no axis is blocked.
        servo_loop.expect(
            motion.predicted, self._predicted, self._lag, self.period, self._expected
        )
        return done

    def following_fault(self) -> str | None:
        """What is wrong where the encoder strays from what the loop would give."""
        if self.motion.mode not in (Mode.PROFILE, Mode.STREAM, Mode.VELOCITY):
            return None
        index = servo_loop.stray(
            self._predicted, self.encoder, self._expected, self._following_limit
        )
        if index < 0:
            return None
        error = abs(self._predicted[index] - self.encoder[index])
        return (
            f'following error of {self._axes[index]} {error * 1e3:.3f} mm exceeds '
            f'{self._following_limit * 1e3:.3f} mm: is the axis blocked?'
        )

    def _warm_up(self) -> None:
        """Compile every kernel before the first tick."""
        self.begin(self.encoder.tolist())
        self.measure(self.encoder.tolist())
        self.motion.move(self.encoder, self.motion.max_velocity, self.encoder)
        self.control()
        for mode in (Mode.VELOCITY, Mode.STREAM):
            self.motion.mode = mode
            self.control()
        self.following_fault()
        self.begin(np.zeros(len(self._axes)).tolist())
