"""The servo plant on MuJoCo: a user's model moves, the twin file's instruments look at it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stage_core.errors import StageError
from stage_core.twin_file import TwinFile
from stage_twin import hooks, kernel, layout
from stage_twin.models import mjcf
from stage_twin.models.plant import instruments
from stage_twin.plant import ServoPlant
from stage_twin.simulate import SimulationResult
from stage_twin.tracker import measure


class MujocoPlant(ServoPlant):
    """A MuJoCo model in place of the kernel's motion; everything else is the twin file's.

    The joints `x` and `y` are the motors; the file's kinematic and sensor effects and its `delay`
    act on them. The model's steps are shortened so that whole ones fill a control period.

    Raises
    ------
    StageError
        If the model cannot be used (:mod:`stage_twin.models.mjcf`), lacks an axis of the twin, or
        the twin has effects of a plant, which are the model's affair.
    """

    def __init__(self, twin: TwinFile, model: str | Path, seed: int = 0) -> None:
        for name in twin.effects.keys() - instruments(twin).effects.keys():
            raise StageError(
                f'effect {name} belongs to the plant, which is {model} here: take it out of '
                'the twin file, or put it into the model'
            )
        self._model = mjcf.load(model)
        found = mjcf.places(self._model, model)
        missing = [axis for axis in twin.axes if axis not in found]
        if missing:
            raise StageError(f'{model} has no joint {missing[0]}, which the twin has: add it')
        import mujoco

        self._places = [found[axis] for axis in twin.axes]
        self._steps = max(1, math.ceil(twin.control_period / self._model.opt.timestep - 1e-6))
        self._model.opt.timestep = twin.control_period / self._steps
        self._data = mujoco.MjData(self._model)
        self._step = mujoco.mj_step
        super().__init__(twin, seed)

    def reset(self, position: Sequence[float] | np.ndarray) -> None:
        """Put the joints at rest at `position` (n_axes,) [m], time at zero."""
        import mujoco

        mujoco.mj_resetData(self._model, self._data)
        for place, at in zip(self._places, position, strict=True):
            self._data.qpos[place.position] = at
        mujoco.mj_forward(self._model, self._data)
        super().reset(position)

    def warm_up(self) -> None:
        """Compile everything that a tick calls; the model is put at rest at zero."""
        super().warm_up()
        self.reset(np.zeros(len(self.names)))

    def _advance(self) -> None:
        arrays, data = self._arrays, self._data
        # The ring holds commands by tick: of one with a fraction of delay the older acts first.
        depth, width = self._forces.shape[1], len(self.names)
        cuts, before, after = [], [], []
        for axis in range(width):
            ticks = int(arrays.schedule[axis, layout.DELAY_TICKS])
            late = arrays.axes[axis, layout.DELAY] / self._period - ticks
            cuts.append(round(late * self._steps))
            at = self._tick - ticks
            after.append(self._forces[axis, at % depth] if at >= 0 else 0.0)
            before.append(self._forces[axis, (at - 1) % depth] if at >= 1 else 0.0)
        for step in range(self._steps):
            for axis, place in enumerate(self._places):
                data.ctrl[place.actuator] = before[axis] if step < cuts[axis] else after[axis]
            self._step(self._model, data)
        for axis, place in enumerate(self._places):
            own, row = self._state[axis], arrays.axes[axis]
            own[layout.POSITION] = data.qpos[place.position]
            own[layout.VELOCITY] = data.qvel[place.dof]
            now = self._time + self._period
            velocity = own[layout.VELOCITY]
            kernel.follow(row, own, own[layout.POSITION], velocity, self._period, now)
            own[layout.RISE] = hooks.heat(row, own, own[layout.VELOCITY], self._period)

    def session(
        self,
        reference: np.ndarray,
        reference_velocity: np.ndarray,
        compensation: np.ndarray | None = None,
        seed: int = 0,
        noise: bool = True,
    ) -> SimulationResult:
        """A session under the twin's controller, from rest at the first reference position.

        Arguments and result as of :func:`stage_twin.simulate.simulate`.
        """
        arrays, period = self._arrays, self._period
        count, width = reference.shape
        more = np.zeros_like(reference) if compensation is None else compensation
        channels = np.zeros((6, count, width))
        controller = np.zeros((width, layout.CONTROLLER_WIDTH))
        force = np.zeros(width)
        self.reset(reference[0])
        kernel.start_controller(self.encoder(), controller)
        for k in range(count):
            channels[0, k] = self.encoder()
            for i in range(width):
                row, own, q = arrays.axes[i], controller[i], channels[0, k, i]
                channels[1, k, i] = kernel.estimate_velocity(row, period, own, q)
                command = kernel.velocity_command(
                    row, q, reference[k, i], reference_velocity[k, i]
                )
                channels[2, k, i] = command + more[k, i]
                force[i] = kernel.velocity_loop(row, period, own, channels[2, k, i])
            channels[3, k], channels[4, k], channels[5, k] = (
                force,
                self.table(),
                self.temperatures(),
            )
            if k + 1 < count:
                self.step(force)
        stamps, points = measure(self.twin, arrays, channels[4].copy(), None, seed, noise)
        names = ('encoder', 'velocity', 'velocity_command', 'force', 'table', 'temperatures')
        return SimulationResult(
            times=np.arange(count) * period,
            tracker_stamps=stamps,
            tracker_points=points,
            **dict(zip(names, channels, strict=True)),
        )
