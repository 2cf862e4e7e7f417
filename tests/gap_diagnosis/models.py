"""A MuJoCo model of the nominal stage, and bags of what MuJoCo makes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.experiment.machine import START, as_session
from session_bags.writer import write_session
from stage_core.session import Session
from stage_core.twin_file import TwinFile
from stage_twin.mujoco_plant import MujocoPlant

from .conftest import nominal, reference

#: A stage of two slides beside each other, as somebody would write it; `{more}` is of joint x,
#: `{motor}` of its actuator.
STAGE = """<mujoco model="stage">
  <!-- an XY stage -->
  <option timestep="0.0005" integrator="implicitfast" gravity="{tilt} 0 -9.81"/>
  <worldbody>
    <body name="carriage_x">
      <joint name="x" type="slide" axis="1 0 0" damping="{damping}"{more}/>
      <inertial pos="0 0 0" mass="{mass}" diaginertia="0.1 0.1 0.1"/>
    </body>
    <body name="carriage_y" pos="0 0 0.1">
      <joint name="y" type="slide" axis="0 1 0" damping="30"/>
      <geom type="box" size="0.1 0.1 0.02" mass="8"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="motor_x" joint="x"{motor}/>
    <motor name="motor_y" joint="y" forcerange="-600 600"/>
  </actuator>
</mujoco>
"""


def stage(
    path: Path,
    more: str = '',
    motor: str = '',
    mass: float = 18.0,
    damping: float = 40.0,
    tilt: float = 0.0,
    lag: float = 0.0,
) -> Path:
    """The model with something else on axis x; `lag` is that of its actuator [s]."""
    text = STAGE.format(more=more, motor=motor, mass=mass, damping=damping, tilt=tilt)
    if lag:
        old, new = '<motor name="motor_x"', f'<general dyntype="filterexact" dynprm="{lag}"'
        text = text.replace(old, new)
    path.write_text(text)
    return path


def controller(folder: Path, axes: tuple[str, ...] = ('x', 'y')) -> Path:
    """The twin file beside the model; its masses count for nothing."""
    twin = nominal(axes)
    own = {a: replace(twin.servo(a), mass=1.0, viscous=0.0) for a in axes}
    replace(twin, axes=own).save(folder / 'controller.yaml')
    return folder / 'controller.yaml'


def session(model: Path, twin: TwinFile, duration: float = 12.0, noise: bool = True) -> Session:
    """What MuJoCo makes of a model under the twin's controller."""
    path = reference(duration, twin.control_period, len(twin.axes))
    rate = np.gradient(path, twin.control_period, axis=0)
    run = MujocoPlant(twin, model).session(path, rate, noise=noise)
    return as_session(run, twin, path, START, 'mujoco')


def bag(folder: Path, model: Path, twin: TwinFile, **how: Any) -> Path:
    """A bag of that session."""
    return write_session(folder, session(model, twin, **how))
