"""The stepper stage of paper 1: two stacked axes that follow their motor steps without feedback.

Microstep 0.047625 µm, 104 mm/s, accuracy 15 µm and repeatability 3 µm (section 2 of paper 1).
The accuracy comes from the kinematic effects of the twin file, the repeatability from its key
`repeatability` [m]: where a move ends scatters by a normal deviate, four standard deviations
wide in all (ISO 230-2: R = 4 s).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from stage_core.errors import StageError
from stage_core.twin_file import StepperAxis, TwinFile
from stage_twin import hooks, kernel, layout
from stage_twin.geometry import table_point
from stage_twin.packing import pack
from stage_twin.profile import Piece, plan_move, plan_stop
from stage_twin.tracker import to_tracker_frame


@dataclass
class _AxisMotion:
    steps: float = 0.0
    velocity: float = 0.0
    pieces: list[Piece] = field(default_factory=list)
    # Scatter of where the axis stands: from the last move's to this move's, over its length.
    scatter: float = 0.0
    scatter_from: float = 0.0
    scatter_to: float = 0.0
    move_start: float = 0.0
    move_end: float = 0.0


class StepperPlant:
    """The stepper stage at any time: commands plan a motion, :meth:`advance_to` follows it.

    Axes are counted 0, 1 in the order of the twin; positions in motor steps, speeds in steps/s,
    accelerations in steps/s^2.

    Raises
    ------
    StageError
        If the twin is not a stepper twin, or is wrong.
    """

    def __init__(self, twin: TwinFile, seed: int = 0) -> None:
        if twin.kind != 'stepper':
            raise StageError(f'a stepper plant needs kind stepper, this twin file is {twin.kind}')
        self.twin = twin
        self._arrays = pack(twin)
        self._axes = [axis for axis in twin.axes.values() if isinstance(axis, StepperAxis)]
        self._scatter = (twin.repeatability or 0.0) / 4.0
        self._random = np.random.default_rng(seed)
        self._noise = np.random.default_rng((seed, 1))
        self._time = 0.0
        self._motion = [_AxisMotion() for _ in self._axes]
        self._state = np.zeros((len(self._axes), layout.STATE_WIDTH))
        self._latency = -float(hooks.true_time(self._arrays.common, np.zeros(1))[0])
        # Table positions (time, point) back to the tracker's latency.
        self._seen: deque[tuple[float, np.ndarray]] = deque()

    def reset(self, steps: Sequence[float]) -> None:
        """Put the axes at rest at these motor steps, the play centred."""
        self._time = 0.0
        self._seen.clear()
        self._motion = [_AxisMotion(steps=float(count)) for count in steps]
        motor = [float(n) * axis.microstep for n, axis in zip(steps, self._axes, strict=True)]
        kernel.start_plant(self._arrays.axes, np.array(motor), self._state)

    def move_abs(
        self, axis: int, steps: float, speed: float | None = None, accel: float | None = None
    ) -> None:
        """Start a move to `steps` now; it takes the place of any motion of that axis."""
        motion = self._motion[axis]
        speed, accel = self._limits(axis, speed, accel)
        motion.pieces = plan_move(
            self._time, motion.steps, motion.velocity, float(steps), speed, accel
        )
        motion.scatter_from = motion.scatter
        motion.scatter_to = self._scatter * float(self._random.standard_normal())
        motion.move_start = motion.steps
        motion.move_end = float(steps)

    def stop(self, axis: int, accel: float | None = None) -> None:
        """Brake to rest now."""
        motion = self._motion[axis]
        _, accel = self._limits(axis, None, accel)
        motion.pieces = plan_stop(self._time, motion.steps, motion.velocity, accel)
        motion.move_start = motion.move_end = motion.steps

    def busy(self, axis: int) -> bool:
        """Whether the axis moves."""
        return bool(self._motion[axis].pieces)

    def position_steps(self, axis: int) -> int:
        """Motor position in whole steps."""
        return int(np.rint(self._motion[axis].steps))

    def velocity_steps(self, axis: int) -> float:
        """Motor speed [steps/s], signed."""
        return self._motion[axis].velocity

    def advance_to(self, time: float) -> None:
        """Follow every planned motion up to `time` [s]; an earlier time changes nothing."""
        if time <= self._time:
            return
        for index, motion in enumerate(self._motion):
            while motion.pieces:
                piece = motion.pieces[0]
                motion.steps, motion.velocity = piece.at(time)
                self._follow(index, min(time, piece.end))
                if time < piece.end:
                    break
                motion.pieces.pop(0)
                if not motion.pieces:
                    # A motor at rest stands on a whole microstep.
                    motion.velocity = 0.0
                    motion.steps = float(np.rint(motion.steps))
        self._time = time
        if self._latency > 0.0:
            self._seen.append((time, self.table()))
            while len(self._seen) > 2 and self._seen[1][0] < time - self._latency:
                self._seen.popleft()

    def table(self, time: float | None = None) -> np.ndarray:
        """Table position (n_axes,) [m] at `time` (now by default), which the stage moves up to."""
        if time is not None:
            self.advance_to(time)
        out = np.zeros(len(self._axes))
        motor = np.array(
            [self.position_steps(index) * axis.microstep for index, axis in enumerate(self._axes)]
        )
        scatter = np.array([motion.scatter for motion in self._motion])
        played = self._state[:, layout.PLAYED] + scatter
        rise = self._state[:, layout.RISE]
        table_point(self._arrays, motor, played, rise, out)
        return out

    def tracker_point(self, time: float, noise: bool = True) -> tuple[float, np.ndarray]:
        """Stamp [s] and point (3,) [m] that the tracker gives at `time`, which is now or later."""
        table = self.table(time)
        if self._latency > 0.0 and self._seen:
            stamps, points = zip(*self._seen, strict=True)
            table = np.array(
                [np.interp(time - self._latency, stamps, column) for column in np.array(points).T]
            )
        point = to_tracker_frame(self._arrays.common, table[None, :])[0]
        if noise and self.twin.tracker is not None:
            point += self.twin.tracker.noise * self._noise.standard_normal(3)
        return float(hooks.stamp(self._arrays.common, np.array([time]))[0]), point

    def _limits(self, axis: int, speed: float | None, accel: float | None) -> tuple[float, float]:
        own = self._axes[axis]
        limit = own.max_speed / own.microstep
        wanted = limit if speed is None else min(abs(speed), limit)
        return wanted, own.acceleration / own.microstep if accel is None else accel

    def _follow(self, index: int, time: float) -> None:
        motion = self._motion[index]
        length = motion.move_end - motion.move_start
        if length != 0.0:
            done = min(max((motion.steps - motion.move_start) / length, 0.0), 1.0)
            motion.scatter = motion.scatter_from + done * (motion.scatter_to - motion.scatter_from)
        microstep = self._axes[index].microstep
        kernel.follow(
            self._arrays.axes[index],
            self._state[index],
            self.position_steps(index) * microstep,
            motion.velocity * microstep,
            time - self._time,
            time,
        )
