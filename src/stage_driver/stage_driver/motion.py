"""Reference of every tick, or velocity command: hold, move, home, velocity, stream, stop.

Pure and without clocks: `MotionGenerator.tick` advances one control period.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

import numpy as np

from stage_core.arrays import Array
from stage_driver import servo_loop
from stage_driver.limits import AxisLimits, Setpoint, SetpointKind
from stage_driver.profile import profile_tick, seed_window, step_speed, stream_tick, within

#: Slower than this counts as at rest when a stop ends [m/s]; the position loop takes the rest.
REST_SPEED = 1e-9


class Mode(Enum):
    """What the generator does."""

    HOLD = 'hold'
    PROFILE = 'profile'
    VELOCITY = 'velocity'
    STREAM = 'stream'
    STOPPING = 'stopping'


class MotionGenerator:
    """Turns set-points into r_k and dr_k within the limits; while it steers speed, vc_k too.

    Parameters
    ----------
    limits
        Soft limits per axis; profiles keep them, a stream is clamped so that it can still brake.
    gains
        Array (axes, 6) of `servo_loop.loop_gains`.
    period
        Control period Ts [s].
    max_jerk
        Jerk limit of position moves [m/s^3].
    settle_time
        Dwell after a move before it counts as done [s].
    """

    def __init__(
        self,
        limits: Sequence[AxisLimits],
        gains: Array,
        period: float,
        max_jerk: float,
        settle_time: float,
    ) -> None:
        count = len(limits)
        self.lower = np.array([limit.lower for limit in limits])
        self.upper = np.array([limit.upper for limit in limits])
        self.max_velocity = np.array([limit.max_velocity for limit in limits])
        self.max_acceleration = np.array([limit.max_acceleration for limit in limits])
        self.stop_deceleration = np.array([limit.stop_deceleration for limit in limits])
        self.gains = gains
        self.period = period
        self.settle_ticks = round(settle_time / period)
        jerk_ticks = max(1, round(float(self.max_acceleration.max()) / max_jerk / period))
        self.mode = Mode.HOLD
        self.reference = np.zeros(count)
        #: Where the stream would be now, had its next set-point come: the reference elsewhere.
        self.predicted = np.zeros(count)
        self.speed = np.zeros(count)
        self.command = np.zeros(count)
        self.clamped = 0
        self._generators = np.zeros((count, 2))
        self._windows = np.zeros((count, jerk_ticks))
        self._targets = np.zeros(count)
        self._move_speeds = self.max_velocity.copy()
        self._wanted = np.zeros(count)
        self._stream_positions = np.zeros(count)
        self._stream_age = 0
        self._dwell = 0

    @property
    def at_rest(self) -> bool:
        """Whether nothing is left to execute."""
        return self.mode is Mode.HOLD

    @property
    def streaming(self) -> bool:
        """Whether the motion depends on fresh set-points."""
        return self.mode in (Mode.VELOCITY, Mode.STREAM)

    @property
    def follows_reference(self) -> bool:
        """Whether `command` is for the position loop to give."""
        return self.mode in (Mode.HOLD, Mode.PROFILE)

    def hold(self, encoder: Array) -> None:
        """Hold here: the reference of a start, or after the position jumped."""
        self.mode = Mode.HOLD
        self.reference[:] = encoder
        self._targets[:] = encoder
        self.speed[:] = 0.0
        self.command[:] = 0.0

    def come_to_rest(self, encoder: Array) -> None:
        """Bring a stage of unknown speed to rest: velocity command zero, then hold and dwell."""
        self.hold(encoder)
        self._dwell = self.settle_ticks
        self.mode = Mode.STOPPING

    def take(self, setpoint: Setpoint, encoder: Array) -> None:
        """Execute a checked set-point from now on."""
        if setpoint.kind is SetpointKind.POSITION:
            targets = [
                self._end_of(axis) if value is None else value
                for axis, value in enumerate(setpoint.positions)
            ]
            self.move(np.array(targets), self.max_velocity, encoder)
            return
        for axis, value in enumerate(setpoint.velocities):
            self._wanted[axis] = 0.0 if value is None else value
        if setpoint.kind is SetpointKind.BOTH:
            for axis, value in enumerate(setpoint.positions):
                if value is not None:
                    self._stream_positions[axis] = value
                elif self.mode is not Mode.STREAM:
                    self._stream_positions[axis] = self.reference[axis]
            self._stream_age = 0
            self.mode = Mode.STREAM
        elif self.mode is not Mode.VELOCITY:
            if self.mode is not Mode.HOLD:
                self.reference[:] = encoder
            self.mode = Mode.VELOCITY

    def move(self, targets: Array, speeds: Array, encoder: Array) -> None:
        """Start a profile to `targets` [m] at most at `speeds` [m/s], from any motion."""
        if self.mode not in (Mode.HOLD, Mode.PROFILE):
            # The position loop must go on with the velocity command of now.
            matching = servo_loop.matching_reference(self.command, encoder, self.gains)
            np.clip(matching, self.lower, self.upper, out=self.reference)
            self.speed[:] = self.command
        for axis in range(len(targets)):
            speed = self.speed[axis]
            start = seed_window(self._windows[axis], self.reference[axis], speed, self.period)
            self._generators[axis] = start, speed
        self._targets[:] = targets
        self._move_speeds[:] = np.minimum(speeds, self.max_velocity)
        self._dwell = self.settle_ticks
        self.mode = Mode.PROFILE

    def stop(self, encoder: Array) -> None:
        """Start a controlled stop: the velocity command ramps to zero."""
        if self.mode in (Mode.HOLD, Mode.STOPPING):
            return
        self.reference[:] = encoder
        self._dwell = self.settle_ticks
        self.mode = Mode.STOPPING

    def stop_from(self, encoder: Array, velocity: Array) -> None:
        """Start a controlled stop at the speed of the stage [m/s], not at that of the command."""
        self.come_to_rest(encoder)
        self.command[:] = velocity

    def tick(self, encoder: Array) -> bool:
        """Advance one period, fill `reference` and `speed`; True when a motion ended."""
        if self.mode is Mode.STREAM:
            self.clamped += stream_tick(
                self._stream_positions,
                self._wanted,
                encoder,
                self.lower,
                self.upper,
                self.stop_deceleration,
                self.period,
                self._stream_age,
                self.reference,
                self.speed,
                self.command,
                self.predicted,
            )
            self._stream_age += 1
            return False
        ended = self._advance(encoder)
        self.predicted[:] = self.reference
        return ended

    def _advance(self, encoder: Array) -> bool:
        if self.mode is Mode.PROFILE:
            arrived = profile_tick(
                self._generators,
                self._windows,
                self._targets,
                self._move_speeds,
                self.max_acceleration,
                self.period,
                self.reference,
                self.speed,
            )
            return arrived and self._dwelt()
        if self.mode is Mode.HOLD:
            self.speed[:] = 0.0
            return False
        return self._velocity_tick(encoder)

    def _velocity_tick(self, encoder: Array) -> bool:
        """One tick of a followed velocity, or of a stop."""
        stopping = self.mode is Mode.STOPPING
        resting = True
        for axis in range(len(encoder)):
            if stopping:
                wanted, rate = 0.0, self.stop_deceleration[axis]
            else:
                wanted, rate = self._wanted[axis], self.max_acceleration[axis]
            speed = step_speed(self.command[axis], wanted, rate, self.period)
            # Whichever is ahead of the other: the velocity loop overshoots its ramp a little.
            ahead = max if speed > 0.0 else min
            speed = self._within(axis, speed, ahead(self.reference[axis], encoder[axis]))
            self.speed[axis] = self.command[axis] = speed
            self.reference[axis] += speed * self.period
            resting = resting and abs(speed) < REST_SPEED
        if stopping and resting:
            # From here the position loop holds: where it came to rest is the new reference.
            self.hold(encoder)
            self.move(self.reference, self.max_velocity, encoder)
        return False

    def _within(self, axis: int, velocity: float, position: float) -> float:
        """Velocity that can still brake to rest inside the soft limit ahead [m/s]."""
        kept = within(
            velocity,
            position,
            self.lower[axis],
            self.upper[axis],
            self.stop_deceleration[axis],
            self.period,
        )
        self.clamped += kept != velocity
        return kept

    def _dwelt(self) -> bool:
        if self._dwell > 0:
            self._dwell -= 1
            return False
        self.mode = Mode.HOLD
        return True

    def _end_of(self, axis: int) -> float:
        """Where an axis that a set-point does not name is going to rest [m]."""
        if self.mode is Mode.PROFILE:
            return float(self._targets[axis])
        return float(self.reference[axis])
