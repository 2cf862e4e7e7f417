"""The algorithms without ROS: simulate, calibrate, follow a contour, diagnose, draw.

Each ``# %%`` starts a cell in editors that know notebooks; as a script it runs from top to bottom:

    .venv/bin/python examples/pure_algorithms.py --out pictures
"""

# %% What is used
from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from calibrator.models import make_model
from contour_ctrl import curves, reference
from contour_ctrl.learning import Learner, LearningSettings
from contour_ctrl.rehearsal import Rehearsal
from contour_ctrl.tick import Controller, Gains
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.report.document import sentence
from stage_core import topics
from stage_core.session import Series, Session
from stage_core.twin_file import TwinFile
from stage_reports.figures import error_map
from stage_twin.kinematics import carry
from stage_twin.simulate import SimulationResult, simulate

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument('--out', type=Path, default=Path('pictures'), help='folder of the picture')
out = parser.parse_args().out
generator = np.random.default_rng(0)

# %% Two twins: the nominal one, and a reality with effects that the nominal one lacks
nominal = TwinFile.nominal_servo()
real = nominal.with_effects(
    {
        'backlash.x': {'width': 8e-6},
        'nonorthogonality': {'angle': 80e-6},
        'coulomb_friction.x': {'coulomb': 6.0, 'presliding': 2e-6},
    }
)

# %% Calibration: positions at rest, where the table really is, and models of the difference.
# `carry` takes a known motor path to the table; the play needs to know from where it came.
command = generator.uniform(-0.04, 0.04, (400, 2))
measured = carry(real, command).table + generator.normal(0.0, 0.5e-6, command.shape)
direction = np.sign(np.diff(command, axis=0, prepend=np.zeros((1, 2))))
train, held = slice(0, 280), slice(280, None)
print('calibration: held-out RMS [um]')
errors = {}
for method in ('identity', 'affine', 'structured', 'it2fls'):
    model = make_model(method).fit(command[train], measured[train], direction[train])
    errors[method] = measured[held] - model.predict(command[held], direction[held])
    print(f'  {method:12s} {1e6 * np.sqrt(np.mean(errors[method] ** 2)):6.3f}')

# %% A contour on the real twin, learnt from run to run
plan = reference.plan(curves.circle(0.02), feed=0.05)
controller = Controller(plan, Gains(cross_coupling=20.0))
learner = Learner(len(plan), plan.period, LearningSettings())
results = Rehearsal(real).iterate(controller, learner, 6)
print('circle: contour error RMS of each run [um]')
print('  ' + ' '.join(f'{1e6 * result.contour_rms:.2f}' for result in results))

# %% A session of the real twin, as a bag would hold it
START = 1_750_000_000_000_000_000  # any epoch, in ns


def strokes(duration: float, period: float) -> np.ndarray:
    """Smooth moves of both axes with rests in between, (n, 2) [m]."""
    times = np.arange(round(duration / period)) * period
    path = np.zeros((len(times), 2))
    for axis in range(2):
        begin, place = 0.3, 0.0
        while begin < duration - 1.5:
            target, length = generator.uniform(-0.03, 0.03), generator.uniform(0.4, 1.2)
            s = np.clip((times - begin) / length, 0.0, 1.0)
            path[:, axis] += (target - place) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
            place, begin = target, begin + length + 0.15
    return path


def as_session(path: np.ndarray, rate: np.ndarray, result: SimulationResult) -> Session:
    """The arrays of a simulation under the topics of a session."""

    def series(topic: str, seconds: np.ndarray, columns: dict[str, np.ndarray]) -> Series:
        stamps = START + np.rint(seconds * 1e9).astype(np.int64)
        return Series(topic, stamps, columns)

    def joints(topic: str, **columns: np.ndarray) -> Series:
        values = {f'{k}.{a}': v[:, i] for k, v in columns.items() for i, a in enumerate('xy')}
        return series(topic, result.times, values)

    points = dict(zip('xyz', result.tracker_points.T, strict=True))
    return Session(
        'example',
        {
            topics.REFERENCE: joints(topics.REFERENCE, position=path, velocity=rate),
            topics.COMMAND: joints(
                topics.COMMAND, velocity=result.velocity_command, effort=result.force
            ),
            topics.JOINT_STATES: joints(
                topics.JOINT_STATES, position=result.encoder, velocity=result.velocity
            ),
            topics.TRACKER_POINT: series(topics.TRACKER_POINT, result.tracker_stamps, points),
        },
    )


path = strokes(20.0, nominal.control_period)
rate = np.gradient(path, nominal.control_period, axis=0)
session = as_session(path, rate, simulate(real, path, rate, seed=1))

# %% Where do this session and the nominal twin differ, and why?
diagnosis = diagnose([session], [], nominal, 'nominal')
print('diagnosis: ' + sentence(diagnosis))
for name in diagnosis.accepted:
    values = ', '.join(
        f'{key} {value:.3g} +- {deviation:.2g}'
        for key, (value, deviation) in diagnosis.parameters[name].items()
    )
    print(f'  {name}: {values}')

# %% One picture: what the structured model takes away at the held-out points
figure = error_map(command[held], errors['identity'], errors['structured'])
out.mkdir(parents=True, exist_ok=True)
figure.savefig(out / 'calibration.png')
print(f'picture: {out / "calibration.png"}')
