"""The plant tick by tick, as the emulators of the wire protocols drive it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stage_core.errors import StageError
from stage_core.twin_file import TwinFile
from stage_twin import hooks, kernel, layout
from stage_twin.geometry import table_point
from stage_twin.packing import pack
from stage_twin.tracker import sample_path, to_tracker_frame

#: Ticks of table positions kept for the tracker's latency, above what the latency needs.
SPARE_HISTORY = 8


class ServoPlant:
    """The servo plant of a twin file; the same kernel as :func:`stage_twin.simulate.simulate`.

    Call :meth:`warm_up` once before real time counts: it compiles what the ticks use. The
    arrays that methods return are the plant's own: copy what is kept.

    Raises
    ------
    StageError
        If the twin is not a servo or measured-force twin, or is wrong.
    """

    def __init__(self, twin: TwinFile, seed: int = 0) -> None:
        if twin.kind == 'stepper':
            raise StageError('a servo plant needs a twin file of kind servo, this one is stepper')
        self.twin = twin
        self._arrays = pack(twin)
        self._period = self._arrays.period
        width = len(twin.axes)
        self._random = np.random.default_rng(seed)
        self._state = np.zeros((width, layout.STATE_WIDTH))
        longest = int(self._arrays.schedule[:, layout.DELAY_TICKS].max())
        self._forces = np.zeros((width, longest + 2))
        # Nothing pushes from outside.
        self._external = np.zeros(width)
        self._encoder = np.zeros(width)
        self._table = np.zeros(width)
        self._temperatures = np.zeros(width)
        latency = abs(float(hooks.true_time(self._arrays.common, np.zeros(1))[0]))
        self._history = np.zeros((int(latency / self._period) + SPARE_HISTORY, width))
        self._tick = 0
        self._time = 0.0
        self.reset(np.zeros(width))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the axes."""
        return tuple(self.twin.axes)

    @property
    def time(self) -> float:
        """Time since the last reset [s]."""
        return self._time

    def reset(self, position: Sequence[float] | np.ndarray) -> None:
        """Put the stage at rest at motor position `position` (n_axes,) [m], time at zero."""
        start = np.asarray(position, dtype=float)
        kernel.start_plant(self._arrays.axes, start, self._state)
        self._forces[:] = 0.0
        self._tick = 0
        self._time = 0.0
        self._history[:] = self.table()

    def warm_up(self) -> None:
        """Compile everything that a tick calls, leaving the plant as it was."""
        state, forces, history = self._state.copy(), self._forces.copy(), self._history.copy()
        tick, time = self._tick, self._time
        self.step(np.zeros(len(self.names)))
        self.encoder()
        self.tracker_point(0.0, noise=False)
        self._state[:], self._forces[:], self._history[:] = state, forces, history
        self._tick, self._time = tick, time

    def step(self, force: Sequence[float] | np.ndarray) -> None:
        """Hold `force` (n_axes,) [N] for one tick."""
        for axis in range(len(force)):
            self._forces[axis, self._tick % self._forces.shape[1]] = force[axis]
        self._advance()
        self._tick += 1
        self._time += self._period
        self._history[self._tick % self._history.shape[0]] = self.table()

    def _advance(self) -> None:
        """Move on by one tick under the forces of the ring."""
        kernel.advance(self._arrays, self._state, self._forces, self._tick, self._external)

    def encoder(self) -> np.ndarray:
        """Encoder readings q (n_axes,) [m]."""
        for axis in range(len(self.names)):
            self._encoder[axis] = kernel.encoder(self._arrays.axes[axis], self._state[axis])
        return self._encoder

    def motor_velocity(self) -> np.ndarray:
        """Motor velocities (n_axes,) [m/s]."""
        return self._state[:, layout.VELOCITY]

    def temperatures(self) -> np.ndarray:
        """Screw temperatures (n_axes,) [degC]."""
        np.add(
            self._state[:, layout.RISE], self.twin.temperature_reference, out=self._temperatures
        )
        return self._temperatures

    def table(self) -> np.ndarray:
        """Table position (n_axes,) [m] at the screws' present temperatures."""
        state, share = self._state, self._arrays.axes[:, layout.TABLE_SHARE]
        motor = state[:, layout.POSITION] + share * state[:, layout.DEFLECTION]
        played, rise = state[:, layout.PLAYED], state[:, layout.RISE]
        table_point(self._arrays, motor, played, rise, self._table)
        return self._table

    def tracker_point(self, time: float, noise: bool = True) -> tuple[float, np.ndarray]:
        """What the tracker measures at `time` [s], within the last ticks.

        Returns
        -------
        Stamp of the tracker's clock [s] and the point (3,) [m] in its frame, with latency,
        misalignment and noise.
        """
        stamp = float(hooks.stamp(self._arrays.common, np.array([time]))[0])
        depth = self._history.shape[0]
        kept = min(depth, self._tick + 1)
        oldest = self._tick - kept + 1
        path = self._history[np.arange(oldest, self._tick + 1) % depth]
        wanted = hooks.true_time(self._arrays.common, np.array([stamp])) - (
            self._time - (kept - 1) * self._period
        )
        point = to_tracker_frame(self._arrays.common, sample_path(path, self._period, wanted))[0]
        if noise and self.twin.tracker is not None:
            point += self.twin.tracker.noise * self._random.standard_normal(3)
        return stamp, point
