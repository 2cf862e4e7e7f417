"""The user's model in MuJoCo itself: how far it is off, and its numbers refined there.

The twin of a model is read from its numbers; MuJoCo may move a little otherwise (it softens the
start of friction). What the diagnosis has changed is refined by a few damped Gauss-Newton steps on
the encoder of the fit windows, with MuJoCo as the simulator.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gap_diagnosis.closed_loop.replay import declared_commands
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import held_out_windows, inside, judging, scored_ticks
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.twin_file import TwinFile
from stage_core.whole_file import write_whole
from stage_twin.models.mjcf import Mjcf, differs
from stage_twin.models.plant import Plant
from stage_twin.mujoco_plant import MujocoPlant

Plants = Mapping[str, Plant]

#: Numbers whose small changes move the encoder smoothly; a delay counts in steps of the model.
FREE = ('mass', 'viscous', 'coulomb', 'stiffness', 'gain', 'limit', 'lag')
ROUNDS, STEP = 3, 0.002  # of Gauss-Newton, and relative, of its derivatives
LONGEST = 30.0  # s of a session that are run for it
FINE = 1e-9  # m, step of an encoder that does not count


@dataclass(frozen=True)
class OwnModel:
    """A model that runs the records in MuJoCo.

    Attributes
    ----------
    place : where the file with other numbers is written
    """

    model: Mjcf
    controller: TwinFile
    records: list[Record]
    place: Path

    def run(self, record: Record, path: Path, step: float | None = None) -> Array:
        """Recorded encoder minus that of a model file (n, a) [m], which counts in `step` [m]."""
        axes = {a: self.controller.servo(a) for a in record.axes}
        if step is not None:
            axes = {a: replace(own, encoder_resolution=step) for a, own in axes.items()}
        plant = MujocoPlant(replace(self.controller, axes=dict(axes)), path)
        velocity = np.nan_to_num(record.reference_velocity, nan=0.0)
        commands = declared_commands(record, plant.twin)
        run = plant.session(record.reference, velocity, commands, noise=False)
        return np.asarray(record.encoder - run.encoder)

    def gap(self, path: Path) -> float:
        """RMS [m] over the held-out ticks and the axes of the records."""
        parts = [np.ravel(self.run(r, path)[scored_ticks(r)]) for r in judging(self.records)]
        return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))

    def refined(self, wanted: Plants) -> dict[str, Plant]:
        """The plants with which MuJoCo follows the fit windows best, near these."""
        names = [
            (axis, name)
            for axis, plant in wanted.items()
            for name in FREE
            if differs(getattr(self.model.plants[axis], name), getattr(plant, name))
            and getattr(plant, name) > 0.0
        ]
        best, z = dict(wanted), np.ones(len(names))
        try:
            residual = self._fitted(best)
            for _ in range(ROUNDS if names else 0):
                slopes = np.column_stack(
                    [
                        (self._fitted(_scaled(wanted, names, z + STEP * unit)) - residual) / STEP
                        for unit in np.eye(len(z))
                    ]
                )
                move = np.clip(np.linalg.lstsq(slopes, -residual, rcond=1e-6)[0], -0.2, 0.2)
                trial = self._fitted(_scaled(wanted, names, z + move))
                if float(trial @ trial) >= float(residual @ residual):
                    break
                z, residual = z + move, trial
                best = _scaled(wanted, names, z)
        except StageError:
            # A step left what the file can say: what is there stands.
            pass
        return best

    def _fitted(self, plants: Plants) -> Array:
        """Gap (m,) [m] on the ticks of the first fitted session that fit."""
        record = next(r for r in self.records if not r.held_out_session)
        record = _first(record, LONGEST)
        save(self.place, self.model.write(plants))
        use = ~inside(record.time, held_out_windows(record)) & record.whole(record.time)
        # Steps of the encoder would hide what a small change of a number does.
        return np.ravel(self.run(record, self.place, FINE)[use])


def _scaled(plants: Plants, names: list[tuple[str, str]], factors: Array) -> dict[str, Plant]:
    out = dict(plants)
    for (axis, name), factor in zip(names, factors.tolist(), strict=True):
        out[axis] = replace(out[axis], **{name: factor * getattr(plants[axis], name)})
    return out


def _first(record: Record, seconds: float) -> Record:
    """The first seconds of a record, as far as a run of the loop needs it."""
    count = int(np.searchsorted(record.time, record.time[0] + seconds))
    names = ('time', 'reference', 'reference_velocity', 'velocity_command', 'encoder')
    declared = record.setpoint_velocity
    return replace(
        record,
        setpoint_velocity=None if declared is None else declared[:count],
        **{name: getattr(record, name)[:count] for name in names},
    )


def save(path: Path, text: str) -> None:
    """Write a model with the line ends that it has."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, text)
