"""The servo plant as a machine with instruments: encoders, temperatures, brake and tracker."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from stage_core.clocks import NANOSECONDS
from stage_core.drive_link import SENSORS
from stage_core.errors import StageError
from stage_core.twin_file import TwinFile
from stage_twin.mujoco_plant import MujocoPlant
from stage_twin.plant import ServoPlant

# A servo motor with shorted windings stops like viscous friction; mass / (this time) [s].
BRAKING_TIME = 0.02
REST_SPEED = 1e-5
# A driver leaves a settled stage with the unrest of an encoder count or two, never with more.
MOVING_SPEED = 1e-3


class ServoMachine:
    """One servo stage: what the drive link and the tracker need of the plant, tick by tick.

    Parameters
    ----------
    twin
        A twin file of kind servo.
    seed
        Seed of the tracker's noise.
    noise
        Whether the tracker is noisy.
    model
        MuJoCo model whose joints move in place of the kernel's; empty for the kernel.

    Raises
    ------
    StageError
        When the twin is of another kind or names an unknown effect, or the model cannot be used.
    """

    def __init__(self, twin: TwinFile, seed: int = 0, noise: bool = True, model: str = '') -> None:
        if twin.kind != 'servo':
            raise StageError(f'the twin is of kind {twin.kind}: the drive link needs kind servo')
        self.twin = twin
        self.axes = tuple(twin.axes)
        self.period = twin.control_period
        self.period_ns = round(twin.control_period * NANOSECONDS)
        self._noise = noise
        self._seed = seed
        self._tracker_rate = twin.tracker.rate if twin.tracker else 0.0
        self._points = 0
        self._ticks = 0
        self._force = np.zeros(len(self.axes))
        self._damping = np.array([twin.servo(axis).mass / BRAKING_TIME for axis in self.axes])
        self._limit = np.array([twin.servo(axis).force_limit for axis in self.axes])
        self._model = model
        self._plant = self._new_plant()
        self._plant.warm_up()

    def reset(self) -> None:
        """Put the stage at rest at zero and its time to zero; the noise starts anew."""
        self._plant = self._new_plant()
        self._points = 0
        self._ticks = 0

    def _new_plant(self) -> ServoPlant:
        if self._model:
            return MujocoPlant(self.twin, self._model, seed=self._seed)
        return ServoPlant(self.twin, seed=self._seed)

    def positions(self) -> tuple[float, ...]:
        """Return the encoder readings [m]."""
        return tuple(self._plant.encoder().tolist())

    def temperatures(self) -> tuple[float, ...]:
        """Return the temperatures [degC] in the order of `stage_core.drive_link.SENSORS`.

        A machine with one axis has the sensor of its screw only; frame and air stay at the
        reference temperature.
        """
        screws = tuple(self._plant.temperatures().tolist())
        if len(screws) < 2:
            return screws
        reference = self.twin.temperature_reference
        return screws + (reference,) * (len(SENSORS) - len(screws))

    def step(self, force: Sequence[float] | np.ndarray) -> None:
        """Hold a force (n_axes,) [N] for one tick."""
        self._plant.step(force)
        self._ticks += 1

    def brake(self) -> None:
        """Let one tick pass with the motors shorted (dynamic braking)."""
        np.multiply(self._plant.motor_velocity(), -self._damping, out=self._force)
        np.clip(self._force, -self._limit, self._limit, out=self._force)
        self.step(self._force)

    @property
    def at_rest(self) -> bool:
        """Return whether every motor stands."""
        return bool(np.abs(self._plant.motor_velocity()).max() < REST_SPEED)

    @property
    def moving(self) -> bool:
        """Return whether a motor moves faster than a settled one ever does."""
        return bool(np.abs(self._plant.motor_velocity()).max() > MOVING_SPEED)

    def tracker_points(self) -> Iterator[tuple[int, tuple[float, float, float]]]:
        """Yield the points that the tracker has measured since the last call.

        Yields
        ------
        Stamp of the tracker's clock [ns] since the last reset, and the point [m].
        """
        if not self._tracker_rate:
            return
        now = self._ticks * self.period + 1e-9
        while self._points / self._tracker_rate <= now:
            stamp, point = self._plant.tracker_point(
                self._points / self._tracker_rate, noise=self._noise
            )
            self._points += 1
            x, y, z = point.tolist()
            yield round(stamp * NANOSECONDS), (x, y, z)
